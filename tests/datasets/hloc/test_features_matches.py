"""Reader and writer of hloc's files: conventions, round trip of asfm's own matches, and one-line errors."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest

from asfm.cli import run_command_line
from asfm.config import BackendConfig, Config, MatchingConfig
from asfm.datasets import open_sequence
from asfm.datasets.hloc.features_matches import read_hloc, write_hloc
from asfm.datasets.hloc.image_names import ImageNames, name_images
from asfm.datasets.native.writer import write_native
from asfm.errors import AsfmError
from asfm.geometry.sonar import SonarModel
from asfm.pipeline.feature_matching import extract_matches
from asfm.pipeline.reconstruction import reconstruct
from asfm.recorder import NullRecorder
from asfm.sequence import Sequence
from asfm.simulation.simulate import simulate
from asfm.stages import StageClock
from asfm.types import ExternalMatches, Frame, Keypoints, Matches

FRAMES = 8
SHAPE = (40, 24)
SONAR = SonarModel.evenly_spaced("test", (1.0, 5.0), (-0.5, 0.7), SHAPE, 0.3)
NAMES = ImageNames(("images/a.png", "images/b.png", "images/c.png"), SHAPE)


def make_sequence(count: int = 3) -> Sequence:
    def read(index: int) -> Frame:
        return Frame(index, float(index), np.zeros(SHAPE, dtype=np.float32), np.zeros(SHAPE, dtype=bool))

    return Sequence("test", SONAR, np.arange(float(count)), read)


def make_keypoints(count: int, seed: int) -> Keypoints:
    rng = np.random.default_rng(seed)
    row_column = rng.uniform(0, 1, (count, 2)) * SHAPE
    return Keypoints(
        row_column,
        SONAR.range_at_row(row_column[:, 0]),
        SONAR.bearing_at_column(row_column[:, 1]),
        rng.random(count),
        rng.integers(0, 256, (count, 61), dtype=np.uint8),
        np.zeros((0, 1, 1), dtype=np.float32),
    )


KEYPOINTS = [make_keypoints(count, count) for count in (5, 0, 7)]
MATCHES = [Matches(0, 2, np.array([[0, 6], [3, 1], [4, 0]]), np.array([0.1, 0.5, 0.25]))]


@pytest.fixture
def files(tmp_path: Path) -> tuple[Path, Path]:
    paths = tmp_path / "features.h5", tmp_path / "matches.h5"
    write_hloc(*paths, NAMES, KEYPOINTS, MATCHES)
    return paths


def read(files: tuple[Path, Path], names: ImageNames = NAMES) -> ExternalMatches:
    return read_hloc(*files, make_sequence(), names)


@pytest.mark.parametrize("descending", [False, True])
def test_written_keypoints_and_matches_are_read_back(tmp_path: Path, descending: bool) -> None:
    names, paths = replace(NAMES, descending=descending), (tmp_path / "f.h5", tmp_path / "m.h5")
    write_hloc(*paths, names, KEYPOINTS, MATCHES)
    found = read(paths, names)
    for ours, theirs in zip(KEYPOINTS, found.keypoints, strict=True):
        np.testing.assert_allclose(theirs.row_column, ours.row_column, atol=1e-12)
        np.testing.assert_allclose(theirs.bearing_rad, ours.bearing_rad, atol=1e-12)
        np.testing.assert_allclose(theirs.range_m, ours.range_m, atol=1e-12)
        np.testing.assert_array_equal(theirs.descriptors, ours.descriptors)
        np.testing.assert_array_equal(theirs.response, ours.response)
    (match,) = found.matches
    assert (match.frame_a, match.frame_b, found.longest_gap) == (0, 2, 2)
    np.testing.assert_array_equal(match.index, MATCHES[0].index)
    np.testing.assert_allclose(match.cost, MATCHES[0].cost)


def write_by_hand(folder: Path, names: tuple[str, str]) -> tuple[Path, Path]:
    """Write two images as hloc itself does: (x, y) with whole numbers at pixel centres, matches from late to early."""
    paths = folder / "f.h5", folder / "m.h5"
    with h5py.File(paths[0], "w") as file:
        for name in names:
            file[f"{name}/keypoints"] = np.array([[0.0, 0.0], [3.0, 10.0]], dtype=np.float32)
            file[f"{name}/descriptors"] = np.array([[1.0, 2.0], [3.0, 4.0], [5.0, 6.0]], dtype=np.float16)
    late, early = names[1].replace("/", "-"), names[0].replace("/", "-")
    with h5py.File(paths[1], "w") as file:
        file[f"{late}/{early}/matches0"] = np.array([-1, 0], dtype=np.int32)
        file[f"{late}/{early}/matching_scores0"] = np.array([0.0, 0.75], dtype=np.float16)
    return paths


@pytest.mark.parametrize("names", [("images/a.png", "images/b.png"), ("a.png", "b.png"), ("images/a", "b")])
def test_pixel_centres_directions_and_names(tmp_path: Path, names: tuple[str, str]) -> None:
    """(3, 10) is the centre of a pixel, so (3.5, 10.5) in asfm; a match from late to early is reversed."""
    known = ImageNames(("images/a.png", "images/b.png"), SHAPE)
    found = read_hloc(*write_by_hand(tmp_path, names), make_sequence(2), known)
    np.testing.assert_allclose(found.keypoints[1].row_column, [[0.5, 0.5], [10.5, 3.5]])
    np.testing.assert_allclose(found.keypoints[1].range_m, SONAR.range_m[[0, 10]])
    np.testing.assert_allclose(found.keypoints[1].bearing_rad, SONAR.bearing_rad[[0, 3]])
    np.testing.assert_array_equal(found.keypoints[0].descriptors, [[1, 3, 5], [2, 4, 6]])
    (match,) = found.matches
    assert (match.frame_a, match.frame_b, match.index.tolist()) == (0, 1, [[0, 1]])
    assert match.cost == pytest.approx([0.25])


def test_columns_from_port_to_starboard_are_flipped(tmp_path: Path) -> None:
    known = ImageNames(("a", "b"), SHAPE, descending=True)
    found = read_hloc(*write_by_hand(tmp_path, ("a", "b")), make_sequence(2), known)
    np.testing.assert_allclose(found.keypoints[0].bearing_rad, SONAR.bearing_rad[[-1, -4]])


def test_a_pair_stored_twice_is_read_from_the_earlier_frame(files: tuple[Path, Path]) -> None:
    with h5py.File(files[1], "a") as file:
        file["images-c.png/images-a.png/matches0"] = np.full(7, -1)
    assert len(read(files).matches[0]) == 3


Damage = Callable[[Any, Any], object]


def _replace(file: Any, name: str, values: Any) -> None:
    del file[name]
    file[name] = values


A, PAIR = "images/a.png", "images-a.png/images-c.png"
FAULTS: dict[str, tuple[Damage, str]] = {
    "no image": (lambda f, m: [f.pop(name) for name in list(f)], "features.h5.*'keypoints', found none"),
    "a missing image": (lambda f, m: f.pop("images/b.png"), r"features.h5.*all 3 images.*none for 'images/b.png'"),
    "an unknown image": (
        lambda f, m: f.copy(A, "images/x.png"),
        "features.h5: expected images of the sequence.*'images/x.png'",
    ),
    "an image twice": (lambda f, m: f.copy(A, "a.png"), "second group of frame 0"),
    "three columns": (lambda f, m: _replace(f, f"{A}/keypoints", np.zeros((5, 3))), r"keypoints of.*\[5, 3\]"),
    "NaN": (lambda f, m: _replace(f, f"{A}/keypoints", np.full((5, 2), np.nan)), r"finite numbers in keypoints.*row 0"),
    "text": (lambda f, m: _replace(f, f"{A}/keypoints", "many"), "expected numbers in keypoints"),
    "outside": (lambda f, m: _replace(f, f"{A}/keypoints", np.full((5, 2), 99.0)), "keypoint 0 at .* lies outside"),
    "few scores": (lambda f, m: _replace(f, f"{A}/scores", np.zeros(4)), r"scores of the shape \[5\], found \[4\]"),
    "few descriptors": (lambda f, m: _replace(f, f"{A}/descriptors", np.zeros((8, 4))), r"descriptors of the shape"),
    "another size": (lambda f, m: _replace(f, f"{A}/image_size", np.array([99, 40])), "expected image_size"),
    "an image's link": (
        lambda f, m: _replace(f, f"{A}/keypoints", h5py.ExternalLink("/etc/x.h5", "/y")),
        "cannot read as HDF5|link to another file",
    ),
    "no pair": (lambda f, m: m.pop("images-a.png"), "matches.h5.*'matches0', found none"),
    "an unknown pair": (lambda f, m: m.copy(PAIR, "images-a.png/who.png"), "two images of the sequence.*who.png"),
    "a frame with itself": (lambda f, m: m.copy(PAIR, "images-a.png/a.png"), "two images of the sequence"),
    "few matches": (lambda f, m: _replace(m, f"{PAIR}/matches0", np.zeros(4, dtype=int)), r"shape \[5\], found \[4\]"),
    "broken numbers": (lambda f, m: _replace(m, f"{PAIR}/matches0", np.zeros(5)), "integers in matches0"),
    "an index too far": (lambda f, m: _replace(m, f"{PAIR}/matches0", np.full(5, 7)), r"matches0\[0\] is 7.*0..6"),
    "an index below": (lambda f, m: _replace(m, f"{PAIR}/matches0", np.full(5, -2)), r"matches0\[0\] is -2"),
    "NaN scores": (lambda f, m: _replace(m, f"{PAIR}/matching_scores0", np.full(5, np.nan)), "finite numbers"),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_an_invalid_group_is_reported_in_one_line(files: tuple[Path, Path], fault: str) -> None:
    damage, expected = FAULTS[fault]
    with h5py.File(files[0], "a") as features, h5py.File(files[1], "a") as matches:
        damage(features, matches)
    with pytest.raises(AsfmError, match=expected) as caught:
        read(files)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("which", [0, 1])
@pytest.mark.parametrize("content", [None, b"", b"no HDF5", "half"])
def test_a_file_that_is_not_hdf5_is_reported_in_one_line(
    files: tuple[Path, Path], which: int, content: bytes | str | None
) -> None:
    path = files[which]
    whole = path.read_bytes()
    path.unlink()
    if content is not None:
        path.write_bytes(whole[: len(whole) // 2] if isinstance(content, str) else content)
    with pytest.raises(AsfmError, match=path.name) as caught:
        read(files)
    assert "\n" not in str(caught.value)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    where = tmp_path_factory.mktemp("native") / "tank"
    write_native(where, simulate("tank", frame_count=FRAMES, seed=1).sequence)
    return where


def make_config(*filters: Any) -> Config:
    matching = MatchingConfig(filters=("mutual", "ratio", *filters), guided=False)
    return Config(matching=matching, backend=BackendConfig(rounds=1))


@pytest.fixture(scope="module")
def external(folder: Path, tmp_path_factory: pytest.TempPathFactory) -> ExternalMatches:
    """Return matches that were written and read."""
    sequence, where = open_sequence(folder), tmp_path_factory.mktemp("hloc")
    keypoints, found = extract_matches(sequence, make_config(), NullRecorder(), StageClock())
    names, paths = name_images(folder, sequence), (where / "f.h5", where / "m.h5")
    write_hloc(*paths, names, keypoints, found)
    return read_hloc(*paths, sequence, names)


@pytest.mark.parametrize("filters", [(), ("ssl",), ("arc", "ssl")])
def test_exchanged_matches_give_the_same_tracks_and_poses(
    folder: Path, external: ExternalMatches, filters: tuple[Any, ...], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Matches that are written, read and filtered give the tracks and poses of a run without files.

    Of given matches all neighbouring frames tell the noise, and not a few: here it is as stated for both.
    """
    monkeypatch.setattr("asfm.pipeline.reconstruction.estimate_noise", lambda _, config, *__: config)
    sequence = open_sequence(folder)
    ours = reconstruct(sequence, make_config(*filters)).reconstruction
    theirs = reconstruct(sequence, make_config(*filters), external=external).reconstruction
    assert ours.tracks.count > 30
    np.testing.assert_array_equal(theirs.tracks.track, ours.tracks.track)
    np.testing.assert_allclose(theirs.tracks.range_m, ours.tracks.range_m, atol=1e-9)
    poses = theirs.trajectory.world_from_vehicle
    np.testing.assert_allclose(poses, ours.trajectory.world_from_vehicle, atol=1e-5)


def test_the_command_line_takes_both_files_or_neither(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    sequence = open_sequence(folder)
    keypoints, found = extract_matches(sequence, Config(), NullRecorder(), StageClock())
    paths = tmp_path / "f.h5", tmp_path / "m.h5"
    write_hloc(*paths, name_images(folder, sequence), keypoints, found)
    command = ["run", str(folder), "--output", str(tmp_path / "out"), "--set", "backend.rounds=1", "--no-rerun"]
    assert run_command_line([*command, "--features", str(paths[0])]) == 2
    assert "--features and --matches" in capsys.readouterr().err
    assert run_command_line([*command, "--features", str(paths[1]), "--matches", str(paths[0])]) == 2
    assert "expected groups that hold 'keypoints'" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()
    assert run_command_line([*command, "--features", str(paths[0]), "--matches", str(paths[1])]) == 0
    assert (tmp_path / "out" / "trajectory.tum").is_file()
