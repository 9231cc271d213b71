"""Recognition of formats, and conversion of each to the native folder."""

import dataclasses
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from asfm.datasets import open_sequence, open_truth
from asfm.datasets.native.writer import write_native
from asfm.errors import AsfmError


def test_a_missing_path_is_reported(tmp_path: Path) -> None:
    with pytest.raises(AsfmError, match=r"nowhere: expected a sequence, found none"):
        open_sequence(tmp_path / "nowhere")


@pytest.mark.parametrize("name", ["empty folder", "text", "didson", "config alone"])
def test_an_unknown_format_is_reported_with_the_supported_formats(tmp_path: Path, name: str) -> None:
    path = tmp_path / name
    if name == "text":
        path.write_text("no sonar")
    elif name == "didson":
        path.write_bytes(b"DDF\x04" + bytes(2000))
    else:
        path.mkdir()
        if name == "config alone":
            (path / "Config.json").write_text("{}")
    with pytest.raises(AsfmError, match=r"sequence\.yaml.*Config\.json.*\.aris") as error:
        open_sequence(path)
    assert "\n" not in str(error.value)
    assert open_truth(path) is None


def test_importing_the_readers_loads_no_heavy_library() -> None:
    loaded = "import sys, asfm.datasets; assert not {'cv2', 'gtsam', 'rerun', 'trimesh'} & set(sys.modules)"
    subprocess.run([sys.executable, "-c", loaded], check=True)


@pytest.mark.parametrize("name", ["aris/sample.aris", "holoocean_boat", "turtle_sim", "oculus_tank_b"])
def test_every_format_converts_to_the_native_folder(shared_data: Path, tmp_path: Path, name: str) -> None:
    original = open_sequence(shared_data / name)
    head = dataclasses.replace(original, timestamps_s=original.timestamps_s[:3])
    write_native(tmp_path / "copy", head)
    copy = open_sequence(tmp_path / "copy")
    assert copy.kind == "native" and len(copy) == 3
    np.testing.assert_allclose(copy.sonar.bearing_rad, original.sonar.bearing_rad, atol=1e-11)
    np.testing.assert_allclose(copy.sonar.range_m, original.sonar.range_m, atol=1e-9)
    np.testing.assert_array_equal(copy.timestamps_s, original.timestamps_s[:3])
    for ours, theirs in zip(copy, head, strict=True):
        np.testing.assert_allclose(ours.image, theirs.image, atol=0.5 / 255 + 1e-6)
        np.testing.assert_array_equal(ours.invalid, theirs.invalid)
    assert (copy.groundtruth is None) == (original.groundtruth is None)
