"""Recordings read back with Rerun's own reader: entities, times and values are as logged."""

import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from asfm.datasets import open_sequence
from asfm.diagnostics import Diagnostic
from asfm.geometry.fan import FanGrid
from asfm.geometry.local_origin import shift_reconstruction, shift_trajectory
from asfm.geometry.poses import make_pose
from asfm.geometry.sonar import SonarModel
from asfm.recorder import Recorder
from asfm.sequence import Sequence
from asfm.types import FloatArray, Frame, Keypoints, Landmarks, Matches, Reconstruction, Tracks, Trajectory
from asfm.visualization.rerun_recorder import FAN_WIDTH_PX, RerunRecorder

FRAMES = 6
MIRROR = Diagnostic("mirror-ambiguity", "two mirror images")
SONAR = SonarModel.evenly_spaced("toy sonar", (0.5, 8.0), (-0.6, 0.5), (150, 110), 0.2)
SPOTS = np.array([[60.5, 20.5], [100.5, 90.5], [130.5, 55.5]])
"""(row, column) of the echoes of frame 0; they move by 2 rows per frame."""


def _keypoints(frame: int) -> Keypoints:
    row_column = SPOTS + np.array([2.0 * frame, 0.0])
    count = len(row_column)
    return Keypoints(
        row_column,
        SONAR.range_at_row(row_column[:, 0]),
        SONAR.bearing_at_column(row_column[:, 1]),
        np.ones(count),
        np.zeros((count, 61), np.uint8),
        np.zeros((count, 3, 3), np.float32),
    )


def _mask(frame: int) -> np.ndarray[Any, np.dtype[np.bool_]]:
    mask = np.zeros(SONAR.shape, bool)
    for row, column in (SPOTS + np.array([2.0 * frame, 0.0])).astype(int):
        mask[row - 4 : row + 5, column - 4 : column + 5] = True
    return mask


def _frame(index: int, start_s: float = 0.0) -> Frame:
    """Return an image with three echoes; a fourth, brighter one is marked invalid and must not be visible."""
    image = cv2.GaussianBlur(_mask(index).astype(np.float32), (5, 5), 0)
    invalid = np.zeros(SONAR.shape, bool)
    invalid[10:20, 10:20] = True
    image[12:18, 12:18] = 1.0
    return Frame(index, start_s + 0.5 * index, image * 0.6 + 0.4 * invalid, invalid)


def _poses(count: int) -> FloatArray:
    turn = 0.1 * np.arange(count)
    xyz_m = np.stack([turn * 3, np.sin(turn), 0.2 * turn + 1], axis=-1)
    return make_pose(xyz_m, Rotation.from_euler("zyx", np.stack([turn, 0.3 + 0 * turn, 0.1 * turn], axis=-1)))


def _sequence(start_s: float = 0.0, count: int = FRAMES) -> Sequence:
    stamps_s = np.linspace(start_s, start_s + 0.5 * (count - 1), count)
    elsewhere = make_pose(np.array([5.0, -7.0, 2.0]), Rotation.from_euler("z", 1.0))
    return Sequence(
        "toy",
        SONAR,
        stamps_s,
        lambda index: _frame(index, start_s),
        vehicle_from_sonar=make_pose(np.array([0.4, 0.0, -0.1]), Rotation.from_euler("y", 0.2)),
        odometry=Trajectory(stamps_s, _poses(count)),
        groundtruth=Trajectory(stamps_s, elsewhere @ _poses(count)),
        diagnostics=(Diagnostic("incomplete-records", "two records are left out"),),
    )


def _reconstruction(sequence: Sequence) -> Reconstruction:
    """Return two landmarks, the second poorly constrained; the third echo has none."""
    count = len(sequence)
    frames, spots = np.tile(np.arange(count), 2), np.repeat([0, 1], count)
    keypoints = [_keypoints(frame) for frame in range(count)]
    tracks = Tracks(
        spots,
        frames,
        np.array([keypoints[f].range_m[s] for f, s in zip(frames, spots, strict=True)]),
        np.array([keypoints[f].bearing_rad[s] for f, s in zip(frames, spots, strict=True)]),
    )
    landmarks = Landmarks(
        np.array([0, 1]),
        np.array([[3.0, -1.0, 0.5], [5.0, 1.0, -0.5]]),
        np.tile(1e-4 * np.eye(3), (2, 1, 1)),
        np.array([0.01, 0.5]),
        np.array([count, count]),
        np.array([True, False]),
        np.arange(2 * 5 * 3, dtype=float).reshape(2, 5, 3),
    )
    trajectory, observed = Trajectory(sequence.timestamps_s, _poses(count)), np.ones(len(tracks), bool)
    return Reconstruction(trajectory, tracks, observed, landmarks, np.zeros((0, 6, 6)), (MIRROR,))


def _record(path: Path, sequence: Sequence, reconstruction: Reconstruction | None = None) -> None:
    recorder: Recorder = RerunRecorder(path, sequence)
    for frame in sequence:
        recorder.record_frame(frame, _mask(frame.index), _keypoints(frame.index))
        if frame.index:
            pairs = np.array([[0, 0], [2, 1]])
            proposed = Matches(frame.index - 1, frame.index, np.concatenate([pairs, [[1, 0]]]), np.zeros(3))
            matches = proposed.reject(np.array([False, False, True]), "ssl")
            recorder.record_matches(_keypoints(frame.index - 1), _keypoints(frame.index), matches)
    recorder.record_reconstruction(sequence, reconstruction or _reconstruction(sequence))
    recorder.close()


class Recording:
    """Content of a recording file, read with Rerun's reader."""

    def __init__(self, path: Path) -> None:
        from rerun.chunk import RrdReader

        self.reader = RrdReader(path)
        self.chunks = self.reader.stream().to_chunks()

    def entities(self) -> set[str]:
        return {chunk.entity_path for chunk in self.chunks}

    def timelines(self, entity: str) -> set[str]:
        return {name for chunk in self.chunks if chunk.entity_path == entity for name in chunk.timeline_names}

    def rows(self, entity: str, component: str) -> dict[int | None, list[Any]]:
        """Return the values logged at each frame (None: static), in order; components as flat lists."""
        found: dict[int | None, list[Any]] = {}
        for chunk in self.chunks:
            batch = chunk.to_record_batch() if chunk.entity_path == entity else None
            if batch is not None and component in batch.schema.names:
                values = batch.column(component).to_pylist()
                frames = [None] * len(values) if chunk.is_static else batch.column("frame").to_pylist()
                for frame, value in zip(frames, values, strict=True):
                    found.setdefault(frame, []).append(value)
        return found

    def value(self, entity: str, component: str, frame: int | None = None) -> Any:
        values = self.rows(entity, component)[frame]
        assert len(values) == 1, f"{entity} {component}: {len(values)} values at {frame}"
        return values[0]

    def picture(self, entity: str, frame: int) -> Any:
        blob = self.value(entity, "EncodedImage:blob", frame)[0]
        return cv2.imdecode(np.frombuffer(bytes(blob), np.uint8), cv2.IMREAD_UNCHANGED)


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Recording:
    path = tmp_path_factory.mktemp("recording") / "toy.rrd"
    _record(path, _sequence())
    return Recording(path)


@pytest.fixture(scope="module")
def fan() -> FanGrid:
    return FanGrid.fit(SONAR, FAN_WIDTH_PX)


def test_importing_the_module_does_not_load_rerun() -> None:
    code = "import sys, asfm.visualization.rerun_recorder; sys.exit('rerun' in sys.modules or 'cv2' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


def test_recording_has_its_name_and_a_blueprint(recording: Recording) -> None:
    (entry,) = recording.reader.recordings()
    assert (entry.application_id, entry.recording_id) == ("asfm", "toy")
    assert {entry.application_id for entry in recording.reader.blueprints()} == {"asfm"}


def test_every_frame_is_on_both_timelines(recording: Recording) -> None:
    for view in ("fan", "polar"):
        for name, component in [("image", "EncodedImage:blob"), ("mask", "EncodedImage:blob")]:
            assert set(recording.rows(f"/{view}/{name}", component)) == set(range(FRAMES))
        assert set(recording.rows(f"/{view}/keypoints", "Points2D:positions")) == set(range(FRAMES))
        assert set(recording.rows(f"/{view}/matches", "LineStrips2D:strips")) == set(range(1, FRAMES))
    assert set(recording.rows("/fan/tracks", "LineStrips2D:strips")) == set(range(FRAMES))
    for entity in recording.entities():
        assert recording.timelines(entity) in (set(), {"frame", "time"})


@pytest.mark.parametrize("view", ["fan", "polar"])
def test_keypoints_are_on_the_echoes_of_their_frame(recording: Recording, fan: FanGrid, view: str) -> None:
    for frame in (0, 4):
        picture = recording.picture(f"/{view}/image", frame)
        assert picture.shape == (fan.shape if view == "fan" else SONAR.shape)
        xy_px = np.array(recording.value(f"/{view}/keypoints", "Points2D:positions", frame))
        assert len(xy_px) == len(SPOTS)
        _, labels, _, centroids = cv2.connectedComponentsWithStats((picture > 120).astype(np.uint8))
        assert len(centroids) == 1 + len(SPOTS), "the invalid spot must be dark"
        distances = np.linalg.norm(centroids[1:, None] + 0.5 - xy_px, axis=-1)
        assert distances.min(axis=0).max() < 2.0
        assert labels[tuple(xy_px[0].astype(int)[::-1])] != 0


def test_port_is_left_on_the_fan(recording: Recording, fan: FanGrid) -> None:
    x_px = np.array(recording.value("/fan/keypoints", "Points2D:positions", 0))[:, 0]
    bearing_rad = _keypoints(0).bearing_rad
    assert (bearing_rad > 0).any() and (bearing_rad < 0).any()
    np.testing.assert_array_equal(x_px < fan.width_px / 2, bearing_rad > 0)


def test_mask_is_transparent_outside_and_outlined(recording: Recording) -> None:
    alpha = recording.picture("/polar/mask", 3)[..., 3]
    np.testing.assert_array_equal(alpha > 0, _mask(3))
    assert len(np.unique(alpha)) == 3
    assert recording.picture("/fan/mask", 3).shape[2] == 4


def test_matches_run_from_the_old_to_the_new_position(recording: Recording) -> None:
    for view in ("fan", "polar"):
        before, after = (
            np.array(recording.value(f"/{view}/keypoints", "Points2D:positions", frame))[which]
            for frame, which in ((2, [0, 2]), (3, [0, 1]))
        )
        strips = np.array(recording.value(f"/{view}/matches", "LineStrips2D:strips", 3))
        np.testing.assert_allclose(strips, np.stack([before, after], axis=1))


def test_rejected_matches_are_labelled_with_their_filter(recording: Recording) -> None:
    for view in ("fan", "polar"):
        before, after = (
            np.array(recording.value(f"/{view}/keypoints", "Points2D:positions", frame))[which]
            for frame, which in ((2, 1), (3, 0))
        )
        entity = f"/{view}/rejected/ssl"
        strips = np.array(recording.value(entity, "LineStrips2D:strips", 3))
        np.testing.assert_allclose(strips, [[before, after]])
        assert recording.value(entity, "LineStrips2D:labels", 3) == ["rejected by ssl"]
        colours = [recording.value(name, "LineStrips2D:colors", 3) for name in (entity, f"/{view}/matches")]
        assert colours[0] != colours[1]


def test_tracks_join_consecutive_observations_in_one_colour(recording: Recording) -> None:
    keypoints = [np.array(recording.value("/fan/keypoints", "Points2D:positions", frame))[:2] for frame in (3, 4)]
    strips = np.array(recording.value("/fan/tracks", "LineStrips2D:strips", 4))
    np.testing.assert_allclose(strips, np.stack(keypoints, axis=1), atol=1e-4)
    beginnings = np.array(recording.value("/fan/tracks", "LineStrips2D:strips", 0))
    np.testing.assert_array_equal(beginnings[:, 0], beginnings[:, 1])
    colours = [recording.value("/fan/tracks", "LineStrips2D:colors", frame) for frame in range(FRAMES)]
    assert all(colour == colours[0] for colour in colours) and len(set(colours[0])) == 2


def test_track_with_a_gap_joins_the_observations_around_it(tmp_path: Path) -> None:
    sequence = _sequence()
    full = _reconstruction(sequence)
    keep = full.tracks.frame != 3
    columns = {name: getattr(full.tracks, name)[keep] for name in ("track", "frame", "range_m", "bearing_rad")}
    _record(tmp_path / "gap.rrd", sequence, replace(full, tracks=Tracks(**columns)))
    gap = Recording(tmp_path / "gap.rrd")
    assert gap.value("/fan/tracks", "LineStrips2D:strips", 3) == []
    ends = [np.array(gap.value("/fan/keypoints", "Points2D:positions", frame))[:2] for frame in (2, 4)]
    np.testing.assert_allclose(gap.value("/fan/tracks", "LineStrips2D:strips", 4), np.stack(ends, axis=1), atol=1e-4)


def test_sonar_pose_includes_the_lever_arm(recording: Recording) -> None:
    expected = _poses(FRAMES) @ _sequence().vehicle_from_sonar
    for frame in range(FRAMES):
        translation_m = recording.value("/world/sonar", "Transform3D:translation", frame)[0]
        columns = np.array(recording.value("/world/sonar", "Transform3D:mat3x3", frame)[0]).reshape(3, 3).T
        np.testing.assert_allclose(translation_m, expected[frame, :3, 3], atol=1e-6)
        np.testing.assert_allclose(columns, expected[frame, :3, :3], atol=1e-6)


def test_a_far_world_is_drawn_about_a_local_origin(tmp_path: Path, recording: Recording) -> None:
    """Rerun's floats would round a northing to half a metre: what is drawn is that near the origin."""
    offset_m = np.array([500000.0, 5572000.0, -3000.0])
    sequence = _sequence()
    assert sequence.odometry is not None and sequence.groundtruth is not None
    moved = replace(
        sequence,
        odometry=shift_trajectory(sequence.odometry, offset_m),
        groundtruth=shift_trajectory(sequence.groundtruth, offset_m),
    )
    _record(tmp_path / "far.rrd", moved, shift_reconstruction(_reconstruction(sequence), offset_m))
    far = Recording(tmp_path / "far.rrd")
    for frame in range(FRAMES):
        expected_m, found_m = (r.value("/world/sonar", "Transform3D:translation", frame) for r in (recording, far))
        np.testing.assert_allclose(found_m, expected_m, atol=1e-6)
    for entity, component in (
        ("points", "Points3D:positions"),
        ("arcs", "LineStrips3D:strips"),
        *((name, "LineStrips3D:strips") for name in ("estimate", "odometry", "groundtruth")),
    ):
        expected_m, found_m = (np.array(r.value(f"/world/{entity}", component)) for r in (recording, far))
        np.testing.assert_allclose(found_m, expected_m, atol=1e-6, err_msg=entity)
    near_text, far_text = (r.value("/summary", "TextDocument:text")[0] for r in (recording, far))
    assert "(500000, 5572000, -3000) m" in far_text and "local origin" not in near_text


def test_frustum_bounds_the_field_of_view(recording: Recording) -> None:
    strips = recording.value("/world/sonar/frustum", "LineStrips3D:strips")
    corners_m = np.concatenate([np.array(strip) for strip in strips])
    assert SONAR.sees(corners_m * 0.9999).mean() > 0.3 and not SONAR.sees(corners_m * 1.001)[0]
    assert np.linalg.norm(corners_m, axis=1).max() == pytest.approx(8.0, rel=1e-5)
    assert np.linalg.norm(corners_m, axis=1).min() == pytest.approx(0.5, rel=1e-5)
    vertices_m = np.array(recording.value("/world/sonar/image", "Mesh3D:vertex_positions"))
    texture = np.array(recording.value("/world/sonar/image", "Mesh3D:vertex_texcoords"))
    np.testing.assert_allclose(vertices_m[:, 2], 0)
    bearing_rad = np.arctan2(vertices_m[:, 1], vertices_m[:, 0])
    np.testing.assert_allclose(SONAR.column_at_bearing(bearing_rad) / SONAR.shape[1], texture[:, 0], atol=1e-4)


def test_landmarks_are_points_or_elevation_arcs(recording: Recording) -> None:
    landmarks = _reconstruction(_sequence()).landmarks
    np.testing.assert_allclose(recording.value("/world/points", "Points3D:positions"), landmarks.xyz_m[:1])
    np.testing.assert_allclose(recording.value("/world/arcs", "LineStrips3D:strips"), landmarks.arc_m[1:])
    np.testing.assert_allclose(recording.value("/world/in_view/points", "Points3D:positions", 2), landmarks.xyz_m[:1])
    np.testing.assert_allclose(recording.value("/world/in_view/arcs", "LineStrips3D:strips", 2), landmarks.arc_m[1:])
    (error_bar_m,) = np.array(recording.value("/world/points/sigma", "LineStrips3D:strips"))
    assert np.linalg.norm(error_bar_m - landmarks.xyz_m[0], axis=1) == pytest.approx(2 * 0.01)


def _line(recording: Recording, name: str) -> FloatArray:
    return np.array(recording.value(f"/world/{name}", "LineStrips3D:strips")[0])


def test_trajectories_start_at_one_pose_and_keep_their_shape(recording: Recording) -> None:
    """The truth is the estimate in another world frame, and the odometry equals the estimate."""
    for name in ("estimate", "groundtruth", "odometry"):
        np.testing.assert_allclose(_line(recording, name), _poses(FRAMES)[:, :3, 3], atol=1e-5)
    steps = [recording.value("/world/so_far", "LineStrips3D:strips", frame)[0] for frame in range(1, FRAMES)]
    np.testing.assert_allclose(np.array(steps)[:, 1], _poses(FRAMES)[1:, :3, 3], atol=1e-5)


def test_truth_with_its_own_stamps_is_aligned_where_it_begins(tmp_path: Path) -> None:
    """Truth at another rate that begins late and ends early is aligned with the estimate."""
    sequence = _sequence()
    estimate = Trajectory(sequence.timestamps_s, make_pose(np.arange(6.0)[:, None] * [1, 0, 0], Rotation.identity(6)))
    turned = make_pose(np.array([1.0, 2.0, 3.0]), Rotation.from_euler("xyz", [0.3, 0.2, 0.1]))
    stamps_s = np.linspace(0.7, 2.2, 16)
    truth = turned @ make_pose(stamps_s[:, None] * [2, 0, 0], Rotation.identity(16))
    late = replace(sequence, groundtruth=Trajectory(stamps_s, truth), odometry=None)
    _record(tmp_path / "late.rrd", late, replace(_reconstruction(sequence), trajectory=estimate))
    recording = Recording(tmp_path / "late.rrd")
    np.testing.assert_allclose(_line(recording, "groundtruth"), [[2, 0, 0], [3, 0, 0], [4, 0, 0]], atol=1e-5)
    assert set(recording.rows("/drift/estimate", "Scalars:scalars")) == {2, 3, 4}
    assert "/world/odometry" not in recording.entities()


def test_summary_and_labels_are_logged(recording: Recording) -> None:
    (summary,) = recording.value("/summary", "TextDocument:text")
    for words in ("toy", "6 frames", "2 tracks", "2 landmarks", "1 well constrained", "0.010 m"):
        assert words in summary
    assert "- **Warning:** two records are left out [incomplete-records]\n" in summary
    assert "- **Warning:** two mirror images [mirror-ambiguity]\n" in summary
    assert recording.value("/world/points", "Points3D:labels") == ["track 0: 6 views, sigma 0.010 m"]
    assert recording.value("/world/points", "Points3D:show_labels") == [False]


def test_curves_show_counts_and_drift(recording: Recording) -> None:
    counts = {name: recording.rows(f"/counts/{name}", "Scalars:scalars") for name in ("keypoints", "matches", "tracks")}
    assert counts["keypoints"] == {frame: [[3.0]] for frame in range(FRAMES)}
    assert counts["matches"] == {frame: [[2.0]] for frame in range(1, FRAMES)}
    assert counts["tracks"] == {frame: [[2.0]] for frame in range(FRAMES)}
    for name in ("estimate", "odometry"):
        drift = recording.rows(f"/drift/{name}", "Scalars:scalars")
        assert set(drift) == set(range(FRAMES))
        np.testing.assert_allclose([drift[frame][0][0] for frame in range(FRAMES)], 0, atol=1e-6)


def test_stamps_since_1970_become_dates(tmp_path: Path) -> None:
    _record(tmp_path / "dated.rrd", _sequence(1.7e9))
    chunk = next(chunk for chunk in Recording(tmp_path / "dated.rrd").chunks if chunk.entity_path == "/fan/keypoints")
    assert str(chunk.to_record_batch().column("time").to_pylist()[1]) == "2023-11-14 22:13:20.500000"


def test_tracks_without_any_landmark_are_recorded(tmp_path: Path) -> None:
    sequence = _sequence()
    empty = _empty_reconstruction(sequence)
    full = _reconstruction(sequence)
    _record(tmp_path / "tracks.rrd", sequence, replace(full, landmarks=empty.landmarks))
    assert (tmp_path / "tracks.rrd").stat().st_size > 1000


def _empty_reconstruction(sequence: Sequence) -> Reconstruction:
    none, few = np.zeros(0, int), np.zeros(0)
    landmarks = Landmarks(none, np.zeros((0, 3)), np.zeros((0, 3, 3)), few, none, none > 0, np.zeros((0, 15, 3)))
    trajectory = Trajectory(sequence.timestamps_s, _poses(len(sequence)))
    return Reconstruction(trajectory, Tracks(none, none, few, few), none > 0, landmarks, np.zeros((0, 6, 6)), ())


@pytest.mark.parametrize("count", [1, 3])
def test_run_without_keypoints_is_recorded(tmp_path: Path, count: int) -> None:
    sequence = replace(_sequence(count=count), odometry=None, groundtruth=None, diagnostics=())
    _record(tmp_path / "empty.rrd", sequence, _empty_reconstruction(sequence))
    recording = Recording(tmp_path / "empty.rrd")
    (summary,) = recording.value("/summary", "TextDocument:text")
    assert "0 landmarks" in summary and "No warnings." in summary
    assert not any(entity.startswith("/drift") for entity in recording.entities())


@pytest.mark.parametrize("pitch_rad", [0.0, np.pi / 2])
def test_eye_looks_at_the_scene_from_above_and_aside(tmp_path: Path, pitch_rad: float) -> None:
    """Also where the sonar looks straight down: an eye exactly above would have no defined up direction."""
    sequence = _sequence(count=2)
    pose = make_pose(np.array([[10.0, 20.0, 5.0]] * 2), Rotation.from_euler("zy", [[0.0, pitch_rad]] * 2))
    still = replace(_empty_reconstruction(sequence), trajectory=Trajectory(sequence.timestamps_s, pose))
    _record(tmp_path / "eye.rrd", replace(sequence, vehicle_from_sonar=np.eye(4)), still)
    reader = Recording(tmp_path / "eye.rrd").reader
    eyes, targets = [], []
    for entry in reader.blueprints():
        for chunk in reader.stream(store=entry).to_chunks():
            batch = chunk.to_record_batch()
            if "EyeControls3D:position" in batch.schema.names:
                eyes.append(np.array(batch.column("EyeControls3D:position").to_pylist()[0][0]))
                targets.append(np.array(batch.column("EyeControls3D:look_target").to_pylist()[0][0]))
    scene_m = np.array([10.0, 20.0, 5.0]) + 4.0 * pose[0, :3, 0]
    (which,) = np.nonzero(np.linalg.norm(np.array(targets) - scene_m, axis=1) < 0.1)[0]
    offset_m = eyes[which] - targets[which]
    assert offset_m[2] > 1.0 and np.hypot(*offset_m[:2]) > 1.0


def test_fans_of_narrow_sonars_have_a_limited_height(tmp_path: Path) -> None:
    narrow = SonarModel.evenly_spaced("narrow", (1.0, 8.0), (-0.05, 0.05), SONAR.shape, 0.2)
    sequence = replace(_sequence(count=1), sonar=narrow)
    _record(tmp_path / "narrow.rrd", sequence, _empty_reconstruction(sequence))
    height_px, width_px = Recording(tmp_path / "narrow.rrd").picture("/fan/image", 0).shape
    assert 980 <= height_px <= 1020 and 90 <= width_px <= 110


def test_truth_of_another_time_is_not_drawn(tmp_path: Path) -> None:
    sequence = _sequence()
    assert sequence.groundtruth is not None
    past = Trajectory(sequence.timestamps_s - 100, sequence.groundtruth.world_from_vehicle)
    _record(tmp_path / "past.rrd", replace(sequence, groundtruth=past))
    assert "/world/groundtruth" not in Recording(tmp_path / "past.rrd").entities()


def _rerun(*arguments: str | Path) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "rerun", "rrd", *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, check=False)


def test_equal_runs_give_equal_recordings(tmp_path: Path) -> None:
    for name in ("a.rrd", "b.rrd"):
        _record(tmp_path / name, _sequence())
    assert _rerun("compare", tmp_path / "a.rrd", tmp_path / "b.rrd").returncode == 0
    _record(tmp_path / "c.rrd", replace(_sequence(), diagnostics=()))
    assert _rerun("compare", tmp_path / "a.rrd", tmp_path / "c.rrd").returncode != 0
    assert _rerun("verify", tmp_path / "a.rrd").returncode == 0


def test_recordings_of_real_images_are_small(tmp_path: Path, shared_data: Path) -> None:
    """120 frames of 707 x 512 pixels stay below 20 MB, so ten frames below 1.6 MB."""
    sequence = open_sequence(shared_data / "oculus_tank_b")
    recorder = RerunRecorder(tmp_path / "tank.rrd", sequence)
    for index in range(10):
        frame = sequence.read_frame(index)
        smooth = cv2.blur(frame.image, (5, 5))
        recorder.record_frame(frame, smooth > 1.5 * cv2.blur(frame.image, (61, 61)) + 0.02, _keypoints(0))
    recorder.close()
    assert 0.2e6 < (tmp_path / "tank.rrd").stat().st_size < 1.6e6
