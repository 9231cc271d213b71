"""HoloOcean pickles: what is read, and what a stranger's pickle may not do."""

import builtins
import collections
import datetime
import json
import os
import pickle
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as npst
from scipy.spatial.transform import Rotation

from asfm.datasets import open_sequence
from asfm.datasets.holoocean.safe_pickle import load_pickle
from asfm.errors import AsfmError
from asfm.geometry.poses import invert, make_pose, transform
from asfm.geometry.sonar import project
from asfm.sequence import Sequence

SHAPE = (16, 6)
GEOMETRY = {"Azimuth": 60, "Elevation": 12, "RangeMin": 0.5, "RangeMax": 4.5, "RangeBins": 16, "AzimuthBins": 6}


def make_config(**changes: Any) -> dict[str, Any]:
    sonar = {"sensor_type": "ImagingSonar", "socket": "S", "Hz": 4, "rotation": [0, 45, 0], "configuration": GEOMETRY}
    pose = {"sensor_type": "PoseSensor", "socket": "S", "rotation": [0, 45, 0]}
    sonar.update(changes.pop("sonar", {}))
    pose.update(changes.pop("pose", {}))
    return {"agents": [{"sensors": [{"sensor_type": "DepthSensor"}, pose, sonar]}], **changes}


def make_state(index: int, **changes: Any) -> dict[str, Any]:
    rng = np.random.default_rng(index)
    pose = make_pose(np.array([index, 2.0, 3.0]), Rotation.from_euler("z", 0.1 * index)).astype(np.float32)
    image = rng.random(SHAPE, dtype=np.float32)
    return {"ImagingSonar": image, "PoseSensor": pose, "t": 10.0 + index, "DepthSensor": np.float32(3), **changes}


def write_folder(root: Path, states: list[dict[str, Any]], config: dict[str, Any] | None = None) -> Path:
    (root / "Data").mkdir(parents=True)
    (root / "Config.json").write_text(json.dumps(make_config() if config is None else config))
    for index, state in enumerate(states):
        (root / "Data" / f"{index}.pkl").write_bytes(pickle.dumps(state))
    return root


def test_a_folder_reads_as_it_was_written(tmp_path: Path) -> None:
    states = [make_state(index) for index in range(12)]
    sequence = open_sequence(write_folder(tmp_path / "boat", states))
    assert (sequence.kind, sequence.name, len(sequence), sequence.sonar.shape) == ("holoocean", "boat", 12, SHAPE)
    np.testing.assert_allclose(sequence.sonar.range_edges_m, np.linspace(0.5, 4.5, 17))
    np.testing.assert_allclose(np.degrees(sequence.sonar.bearing_edges_rad), np.linspace(-30, 30, 7), atol=1e-9)
    assert np.degrees(sequence.sonar.elevation_aperture_rad) == pytest.approx(12)
    np.testing.assert_array_equal(sequence.timestamps_s, 10.0 + np.arange(12))
    for frame, state in zip(sequence, states, strict=True):
        np.testing.assert_array_equal(frame.image, state["ImagingSonar"], err_msg="10.pkl comes after 9.pkl")
        assert type(frame.image) is np.ndarray
    assert sequence.groundtruth is not None and sequence.diagnostics == ()
    poses = np.stack([state["PoseSensor"] for state in states])
    np.testing.assert_allclose(sequence.groundtruth.world_from_vehicle, poses, atol=1e-6)
    np.testing.assert_array_equal(sequence.vehicle_from_sonar, np.eye(4))
    assert len(open_sequence(tmp_path / "boat" / "Data")) == 12, "the folder of pickles itself will do"


def test_bytes_and_out_of_range_values_become_0_to_1(tmp_path: Path) -> None:
    grey = np.arange(96, dtype=np.uint8).reshape(SHAPE)
    wild = np.zeros(SHAPE, np.float32)
    wild[0, :4] = [-0.1, 1.7, np.nan, np.inf]
    states = [make_state(0, ImagingSonar=grey), make_state(1, ImagingSonar=wild)]
    sequence = open_sequence(write_folder(tmp_path / "a", states))
    first, second = sequence
    np.testing.assert_array_equal(first.image, (grey / np.float32(255)).astype(np.float32))
    assert not first.invalid.any()
    np.testing.assert_array_equal(second.image[0, :4], [0, 1, 0, 0])
    np.testing.assert_array_equal(np.argwhere(second.invalid), [[0, 2], [0, 3]])


def test_lengths_are_divided_by_ds_factor(tmp_path: Path) -> None:
    sequence = open_sequence(write_folder(tmp_path / "a", [make_state(0), make_state(1)], make_config(ds_factor=2.0)))
    assert sequence.sonar.range_edges_m[[0, -1]] == pytest.approx([0.25, 2.25])
    assert sequence.groundtruth is not None
    np.testing.assert_allclose(sequence.groundtruth.world_from_vehicle[1, :3, 3], [0.5, 1.0, 1.5])


def test_without_usable_times_frames_are_stamped_at_the_sonars_rate(tmp_path: Path) -> None:
    silent = [{key: value for key, value in make_state(index).items() if key != "t"} for index in range(3)]
    stuck = [make_state(index, t=1.0) for index in range(3)]
    unreliable = ["unreliable-stamps"]
    cases = {"none": (silent, []), "stuck": (stuck, unreliable), "some": ([*silent[:2], make_state(2)], unreliable)}
    for name, (states, codes) in cases.items():
        sequence = open_sequence(write_folder(tmp_path / name, states))
        np.testing.assert_allclose(sequence.timestamps_s, [0, 0.25, 0.5])
        assert [item.code for item in sequence.diagnostics] == codes


def test_a_pose_sensor_that_sits_elsewhere_gives_no_ground_truth(tmp_path: Path) -> None:
    config = make_config(pose={"rotation": [0, 0, 0]})
    sequence = open_sequence(write_folder(tmp_path / "a", [make_state(0)], config))
    (diagnostic,) = sequence.diagnostics
    assert sequence.groundtruth is None
    assert diagnostic.code == "pose-not-of-sonar" and "rotation" in diagnostic.message


def test_ticks_without_the_sonar_are_left_out(tmp_path: Path) -> None:
    states = [make_state(0), {"t": 10.5}, make_state(2)]
    sequence = open_sequence(write_folder(tmp_path / "a", states))
    (diagnostic,) = sequence.diagnostics
    assert len(sequence) == 2 and diagnostic.code == "incomplete-records"
    assert "1 of 3 pickles" in diagnostic.message


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"ImagingSonar": np.zeros((3, 3, 3))}, r"expected ImagingSonar as \(ranges, beams\).*\(3, 3, 3\)"),
        ({"ImagingSonar": np.zeros((8, 6))}, r"expected \(16, 6\) \(RangeBins, AzimuthBins\).*found \(8, 6\)"),
        ({"ImagingSonar": "picture"}, r"expected ImagingSonar as"),
        ({"PoseSensor": np.zeros((4, 4))}, r"expected a rotation in the pose"),
        ({"PoseSensor": np.diag([1.0, 1, -1, 1])}, r"expected a rotation in the pose"),
        ({"PoseSensor": np.full((4, 4), np.nan)}, r"expected a finite 4 x 4 pose"),
        ({"PoseSensor": np.eye(3)}, r"expected a finite 4 x 4 pose"),
        ({"t": "noon"}, r"expected one finite number of seconds as t, found 'noon'"),
        ({"t": float("nan")}, r"expected one finite number of seconds as t"),
    ],
)
def test_a_fault_in_a_pickle_is_named(tmp_path: Path, changes: dict[str, Any], message: str) -> None:
    root = write_folder(tmp_path / "a", [make_state(0, **changes)])
    with pytest.raises(AsfmError, match=rf"0\.pkl: {message}") as error:
        open_sequence(root)
    assert "\n" not in str(error.value)


def test_an_image_of_another_size_is_named_when_it_is_read(tmp_path: Path) -> None:
    states = [make_state(0), make_state(1, ImagingSonar=np.zeros((8, 6)))]
    sequence = open_sequence(write_folder(tmp_path / "a", states))
    with pytest.raises(AsfmError, match=r"1\.pkl: expected ImagingSonar of shape \(16, 6\).*found \(8, 6\)"):
        sequence.read_frame(1)


@pytest.mark.parametrize(
    ("config", "message"),
    [
        ("{", r"cannot read the scenario"),
        ("[]", r"the file: "),
        ("{}", r"expected the key 'agents'"),
        (json.dumps({"agents": [{"sensors": []}]}), r"expected a sensor of type ImagingSonar, found 0"),
        (json.dumps(make_config(sonar={"configuration": {"Azimuth": 60}})), r"the key 'Elevation'"),
        (json.dumps(make_config(sonar={"configuration": {**GEOMETRY, "RangeMin": 9}})), r"RangeMin below RangeMax"),
        (json.dumps(make_config(ds_factor=0)), r"ds_factor: .*found 0"),
    ],
)
def test_a_fault_in_the_scenario_is_named(tmp_path: Path, config: str, message: str) -> None:
    root = write_folder(tmp_path / "a", [make_state(0)])
    (root / "Config.json").write_text(config)
    with pytest.raises(AsfmError, match=rf"Config\.json.*{message}"):
        open_sequence(root)


# What a pickle may hold.


@pytest.mark.parametrize("protocol", range(6))
def test_every_protocol_of_numpy_pickles_is_read(tmp_path: Path, protocol: int) -> None:
    values = {
        "f4": np.linspace(0, 1, 12, dtype="<f4").reshape(3, 4),
        "big": np.arange(6, dtype=">i2").reshape(2, 3),
        "fortran": np.asfortranarray(np.arange(12.0).reshape(3, 4)),
        "strided": np.arange(12.0).reshape(3, 4)[:, ::2],
        "bool": np.array([True, False]),
        "text": np.array(["a", "bc"]),
        "empty": np.zeros((0, 3)),
        "scalar": np.float64(2.5),
        "zero_d": np.array(7),
        "plain": [1, (2.5, None, True), "x", {"y": b"z"}],
    }
    path = tmp_path / "a.pkl"
    path.write_bytes(pickle.dumps(values, protocol=protocol))
    found = load_pickle(path)
    assert list(found) == list(values) and found["plain"] == values["plain"]
    for name, value in values.items():
        if name != "plain":
            np.testing.assert_array_equal(np.asarray(found[name]), value)
            assert np.asarray(found[name]).dtype.newbyteorder("=") == np.asarray(value).dtype.newbyteorder("=")


def test_names_of_numpy_1_and_2_are_both_read(tmp_path: Path) -> None:
    content = pickle.dumps(np.arange(3.0), protocol=0)
    assert b"numpy._core" in content or b"numpy.core" in content
    for name in (b"numpy._core", b"numpy.core"):
        path = tmp_path / "a.pkl"
        path.write_bytes(content.replace(b"numpy._core", b"numpy.core").replace(b"numpy.core", name))
        np.testing.assert_array_equal(np.asarray(load_pickle(path)), np.arange(3.0))


@given(npst.arrays(npst.scalar_dtypes(), npst.array_shapes(max_dims=3, max_side=4)), st.integers(2, 5))
@settings(max_examples=40, deadline=None)
def test_an_array_comes_back_the_same_or_is_refused(
    tmp_path_factory: pytest.TempPathFactory, array: np.ndarray, protocol: int
) -> None:
    path = tmp_path_factory.mktemp("any") / "a.pkl"
    path.write_bytes(pickle.dumps(array, protocol=protocol))
    if array.dtype.kind in "biufSU":
        np.testing.assert_array_equal(np.asarray(load_pickle(path)), array)
    else:
        with pytest.raises(AsfmError, match="expected numpy arrays and plain values"):
            load_pickle(path)


# What a pickle may not do.


class Call:
    """Pickles as a call of any function with any arguments."""

    def __init__(self, function: Any, *arguments: Any) -> None:
        self.parts = (function, arguments)

    def __reduce__(self) -> Any:
        return self.parts


def forge(name: str, *arguments: Any) -> bytes:
    """A protocol 2 pickle that calls module.name, which need not exist here."""
    module, _, function = name.rpartition(".")
    head = b"\x80\x02c" + module.encode() + b"\n" + function.encode() + b"\n"
    return head + pickle.dumps(arguments, protocol=2)[2:-1] + b"R."


class Sub(np.ndarray):
    """An array of another class."""


HOSTILE = {
    "os.system": Call(os.system, "touch OWNED"),
    "eval": Call(builtins.eval, "open('OWNED', 'w')"),
    "exec": Call(builtins.exec, "open('OWNED', 'w')"),
    "open": Call(open, "OWNED", "w"),
    "getattr chain": Call(getattr, Call(getattr, Call(__import__, "os"), "path"), "join"),
    "numpy.load": Call(np.load, "OWNED"),
    "numpy.memmap": Call(np.memmap, "OWNED", "u1", "w+", 0, (4,)),
    "ordered dict": collections.OrderedDict(a=1),
    "date": datetime.date(2020, 1, 1),
    "subclass of ndarray": np.arange(3).view(Sub),
    "object array": np.array([{"a": 1}, None], dtype=object),
    "object array with a call": np.array([Call(os.system, "touch OWNED")], dtype=object),
    "record array": np.zeros(2, dtype=[("a", "f4"), ("b", "O")]),
    "dates": np.array(["2020-01-01"], dtype="M8[D]"),
    "sub-array type": np.dtype(("f4", (2,))),
}
FORGED = {
    "ndarray called": forge("numpy.ndarray", (10**9,)),
    "other class": forge("numpy.core.multiarray._reconstruct", dict, (0,), b"b"),
    "dtype of code": forge("numpy.dtype", "f4,O"),
    "huge dtype": forge("numpy.dtype", "V99999999999"),
    "dotted name": b"\x80\x04\x8c\x05numpy\x8c\x0ef2py.os.system\x93.",
    "encoding": forge("_codecs.encode", "x", "zip"),
    "alter a function": b"\x80\x02cnumpy\ndtype\n}X\x01\x00\x00\x00ai\x01b.",
    "state of an array": forge("numpy._core.multiarray._reconstruct", 1)[:-1] + b"]b.",
    "persistent": b"\x80\x02X\x01\x00\x00\x00aQ.",
    "extension": b"\x80\x02\x82\x01.",
    "nothing": b"",
    "cut off": pickle.dumps(np.arange(100.0))[:-30],
    "text": b"hello",
    "deep": b"\x80\x02" + b"(" * 5000 + b"l" * 10,
}


@pytest.mark.parametrize("name", [*HOSTILE, *FORGED])
def test_a_hostile_pickle_is_refused_and_runs_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    monkeypatch.chdir(tmp_path)
    content = FORGED[name] if name in FORGED else pickle.dumps({"ImagingSonar": HOSTILE[name]})
    (tmp_path / "evil.pkl").write_bytes(content)
    with pytest.raises(AsfmError, match=r"evil\.pkl: expected") as error:
        load_pickle(tmp_path / "evil.pkl")
    assert "\n" not in str(error.value)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["evil.pkl"]


def test_the_refusal_names_file_and_class(tmp_path: Path) -> None:
    (tmp_path / "evil.pkl").write_bytes(pickle.dumps(Call(os.system, "touch OWNED")))
    with pytest.raises(AsfmError, match=rf"evil\.pkl: .*{os.system.__module__}\.system"):
        load_pickle(tmp_path / "evil.pkl")


def test_a_hostile_pickle_leaves_the_reader_unaltered(tmp_path: Path) -> None:
    """BUILD on an admitted function must not stick to it."""
    path = tmp_path / "a.pkl"
    path.write_bytes(b"\x80\x02cnumpy\ndtype\nN}X\x09\x00\x00\x00_functionX\x01\x00\x00\x00xs\x86b.")
    with pytest.raises(AsfmError, match="alter a function"):
        load_pickle(path)
    path.write_bytes(pickle.dumps(np.arange(3)))
    np.testing.assert_array_equal(np.asarray(load_pickle(path)), np.arange(3))


# Recordings.


def best_echo_after_transfer(sequence: Sequence, frame_a: int, frame_b: int, is_mirrored: bool) -> float:
    """Send the brightest pixels of one frame, over all elevations, by the true poses into another: mean best echo."""
    assert sequence.groundtruth is not None
    sonar, poses = sequence.sonar, sequence.groundtruth.world_from_vehicle
    step = -1 if is_mirrored else 1
    image_a, image_b = (sequence.read_frame(index).image[:, ::step] for index in (frame_a, frame_b))
    rows, columns = np.nonzero(image_a > np.quantile(image_a, 0.99))
    arcs_m = sonar.elevation_arc(sonar.range_m[rows], sonar.bearing_rad[columns], 21)
    seen_m = transform(invert(poses[frame_b]) @ poses[frame_a], arcs_m)
    range_m, bearing_rad, _ = project(seen_m)
    row = np.minimum(sonar.row_at_range(range_m).astype(int), sonar.shape[0] - 1)
    column = np.minimum(sonar.column_at_bearing(bearing_rad).astype(int), sonar.shape[1] - 1)
    return float(np.where(sonar.sees(seen_m), image_b[row, column], 0.0).max(axis=1).mean())


@pytest.mark.parametrize(("name", "gap", "margin"), [("holoocean_boat", 1, 1.15), ("turtle_sim", 12, 1.0)])
def test_true_poses_agree_with_the_images_and_not_with_their_mirror(
    shared_data: Path, name: str, gap: int, margin: float
) -> None:
    sequence = open_sequence(shared_data / name)
    assert len(sequence) == 60
    pairs = [(start, start + gap) for start in range(0, 60 - gap, 6)]
    upright = np.mean([best_echo_after_transfer(sequence, *pair, is_mirrored=False) for pair in pairs])
    mirrored = np.mean([best_echo_after_transfer(sequence, *pair, is_mirrored=True) for pair in pairs])
    assert upright > margin * mirrored
