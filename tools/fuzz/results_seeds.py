"""Fuzz targets of the files that ``asfm evaluate`` reads: results folder, reference; and of configurations."""

import json
from pathlib import Path

import numpy as np

from asfm.commands.evaluate import evaluate_folder
from asfm.config import Config
from asfm.config_file import dump_config, load_config
from asfm.datasets.tables import read_tum
from asfm.results.points_ply import write_points
from asfm.results.pose_covariances_csv import write_pose_covariances
from asfm.results.tracks_csv import write_tracks
from asfm.results.trajectory_tum import write_trajectory
from asfm.simulation.simulate import sample_path
from asfm.types import Landmarks, Tracks, Trajectory
from tools.fuzz.cases import Target
from tools.fuzz.native_seeds import FRAMES, make_hloc, make_native
from tools.fuzz.recording_seeds import write

FILES = ("report.json", "trajectory.tum", "tracks.csv", "points.ply", "pose_covariances.csv", "config.yaml")


def make_results(folder: Path) -> None:
    """Write the results of a run, and its sequence, into one folder."""
    make_hloc(folder)
    (folder / "landmarks.csv").unlink()  # takes most of the time
    for path in (folder / "truth").iterdir():
        path.unlink()
    (folder / "truth").rmdir()
    stamps_s, poses = np.arange(float(FRAMES)), np.tile(np.eye(4), (FRAMES, 1, 1))
    poses[:, 0, 3] = 0.11 * stamps_s
    trajectory = Trajectory(stamps_s, poses)
    track = np.repeat(np.arange(2), FRAMES)
    frame = np.tile(np.arange(FRAMES), 2)
    range_m, bearing_rad = (np.asarray(values, dtype=float) for values in (2.0 - 0.1 * frame, 0.1 + 0.01 * track))
    tracks = Tracks(track, frame, range_m, bearing_rad, np.full((2 * FRAMES, 2), 0.01), track)
    xyz_m = np.array([[2.0, 0.2, 0.1], [2.0, 0.3, -0.1]])
    covariance_m2 = np.tile(0.01 * np.eye(3), (2, 1, 1))
    views, arc_m = np.full(2, FRAMES), np.zeros((2, 15, 3))
    landmarks = Landmarks(np.arange(2), xyz_m, covariance_m2, np.full(2, 0.1), views, np.array([True, False]), arc_m)
    report = {"sequence": {"path": str(folder)}}
    (folder / "report.json").write_text(json.dumps(report), encoding="utf-8")
    (folder / "config.yaml").write_text(dump_config(Config()), encoding="utf-8")
    write_trajectory(folder / "trajectory.tum", trajectory)
    write_trajectory(folder / "reference.tum", trajectory)
    write_tracks(folder / "tracks.csv", tracks, np.ones(2 * FRAMES, dtype=bool), np.arange(2))
    write_points(folder / "points.ply", landmarks)
    write_pose_covariances(folder / "pose_covariances.csv", stamps_s, np.tile(0.01 * np.eye(6), (FRAMES, 1, 1)))


def _make_hand_tracked(folder: Path) -> None:
    make_results(folder)
    make_native(folder / "again")
    (folder / "again" / "landmarks.csv").rename(folder / "landmarks.csv")


def _read_motion(folder: Path) -> object:
    return sample_path(read_tum(folder / "reference.tum"), 2.0, 80)


CONFIG = write("c.yaml", dump_config(Config()))
RESULTS_TARGETS = {
    **{f"results {name}": Target(name, make_results, evaluate_folder) for name in FILES},
    "results features.h5": Target("features.h5", make_results, evaluate_folder),
    "results matches.h5": Target("matches.h5", make_results, evaluate_folder),
    "evaluated groundtruth.tum": Target("groundtruth.tum", make_results, evaluate_folder),
    "evaluated landmarks.csv": Target("landmarks.csv", _make_hand_tracked, evaluate_folder),
    "--reference": Target(
        "reference.tum", make_results, lambda folder: evaluate_folder(folder, folder / "reference.tum")
    ),
    "motion": Target("reference.tum", make_results, _read_motion),
    "config": Target("c.yaml", CONFIG, lambda folder: load_config(folder / "c.yaml")),
}
