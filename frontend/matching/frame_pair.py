"""Frame pair: two frames' keypoints and the matches proposed between them, with the predicted elevation arcs."""

from dataclasses import dataclass, replace

from asfm.config import NoiseConfig
from asfm.frontend.matching.nearest import NearestNeighbours
from asfm.geometry.elevation_arcs import project_arcs
from asfm.geometry.feature_noise import difference_sigma
from asfm.geometry.sonar import SonarModel
from asfm.navigation.pose_prediction import PosePrediction
from asfm.types import BoolArray, FloatArray, IntArray, Keypoints


@dataclass(frozen=True)
class FramePair:
    """Input of the outlier filters: the keypoints of two frames and the matches between them."""

    keypoints_a: Keypoints
    keypoints_b: Keypoints
    nearest: NearestNeighbours
    """(M,) matches, their ratios, and whether they are mutual."""
    sonar: SonarModel
    arcs: FloatArray | None = None
    """(Ka, G, 2) range_m and bearing_rad of frame a's elevation arcs as predicted in frame b; None without poses."""
    sigma: FloatArray | None = None
    """(Ka, 2) standard deviations of that prediction and of a keypoint's position, in range_m and bearing_rad."""
    ssl_loss: FloatArray | None = None
    """(Ka,) structural-and-spatial losses of the matches of frame a's keypoints, NaN where not yet computed; the filter
    adds what it computes. None: nothing is kept."""

    def __len__(self) -> int:
        return len(self.nearest.index)

    @property
    def index(self) -> IntArray:
        """(M, 2) keypoint of frame a, keypoint of frame b."""
        return self.nearest.index

    def pixels(self) -> tuple[FloatArray, FloatArray]:
        """Return range_m and bearing_rad of the matches in both frames, (M, 2) each."""
        sides = zip((self.keypoints_a, self.keypoints_b), self.index.T, strict=True)
        a, b = (frame.range_bearing[which] for frame, which in sides)
        return a, b

    def take(self, which: BoolArray) -> "FramePair":
        """Return the same pair with the selected (M,) matches only."""
        old = self.nearest
        nearest = NearestNeighbours(old.index[which], old.ratio[which], old.mutual[which])
        return replace(self, nearest=nearest)


def predict_arcs(
    frames: tuple[int, int], a: Keypoints, sonar: SonarModel, prediction: PosePrediction, noise: NoiseConfig
) -> tuple[FloatArray, FloatArray]:
    """Project the elevation arcs of a frame's keypoints into another frame under predicted poses.

    Args:
        frames: indices of frames a and b.
        a: the (Ka,) keypoints of frame a.
        sonar: gives the aperture.
        prediction: poses before the images are read.
        noise: of a keypoint's position.

    Returns:
        (Ka, G, 2) range_m and bearing_rad of the arcs in frame b, (Ka, 2) their standard deviations.
    """
    sigma = prediction.predicted_sigma(*frames, a.range_m, difference_sigma(sonar, noise))
    return project_arcs(sonar, prediction.relative_pose(*frames), a.range_bearing), sigma
