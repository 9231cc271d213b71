"""Names of the files in the results folder of ``asfm run``."""

from asfm.atomic_folder import FolderKind

TRAJECTORY = "trajectory.tum"
POINTS = "points.ply"
POSE_SIGMAS = "pose_sigmas.csv"
POSE_COVARIANCES = "pose_covariances.csv"
TRACKS = "tracks.csv"
FEATURES = "features.h5"
MATCHES = "matches.h5"
RECORDING = "reconstruction.rrd"
REPORT = "report.json"
CONFIG = "config.yaml"
EVALUATION = "evaluation.json"
EVALUATION_PARTIAL = ".evaluation.json.partial"
"""Left behind when ``asfm evaluate`` is killed while it writes."""

RESULTS = FolderKind(
    name="results",
    marks=(REPORT, CONFIG),
    patterns=(
        *(TRAJECTORY, POINTS, POSE_SIGMAS, POSE_COVARIANCES, TRACKS, FEATURES, MATCHES, RECORDING),
        *(REPORT, CONFIG, EVALUATION, EVALUATION_PARTIAL),
    ),
)
"""The folder that ``asfm run`` writes."""
