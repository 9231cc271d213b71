"""Matcher quality of a run as a whole: matches, localisation error, tracks and coverage of the image."""

from collections import abc
from dataclasses import dataclass

from asfm.evaluation.association import within_reach
from asfm.evaluation.image_coverage import measure_coverage
from asfm.evaluation.match_statistics import LocalisationError, PairStatistics, measure_pairs, pool_statistics
from asfm.evaluation.track_quality import measure_tracks
from asfm.evaluation.trajectory import interpolate_groundtruth
from asfm.sequence import Sequence
from asfm.types import FrameTruth, Keypoints, Matches, Tracks

NEEDS_ELEVATIONS = ("precision", "recall", "localisation error", "track purity")
NEEDS_POSES = ("arc inlier ratio",)


@dataclass(frozen=True)
class MatcherQuality:
    """Quality of the features, matches and tracks of a run; None where the truth a measure needs is missing."""

    matches: int
    """All matches; the measures below count those between frames with known true poses."""
    precision: float | None
    """Correct matches over all."""
    recall: float | None
    """Keypoints matched correctly over those that have a correct partner, over all frame pairs listed."""
    arc_inlier_ratio: float | None
    """Share of matches on their elevation arc under the true poses; its tolerance is another than precision's."""
    error: LocalisationError | None
    """Localisation error of the correct matches."""
    tracks: int
    track_length: float | None
    """Observations of a track, mean."""
    track_length_median: float | None
    track_purity: float | None
    """Share of a track's observations that belong to its true point, mean over the tracks."""
    keypoint_coverage: float | None
    """Share of the cells of a grid of 16 x 16 over the image that hold a keypoint, mean over the frames."""
    match_coverage: float | None
    """The same for matched keypoints."""
    left_out: tuple[str, ...] = ()
    """Measures that need truth which the sequence lacks."""

    def as_dict(self) -> dict[str, float | None]:
        """Return the measures by name, the localisation errors as ``range_bias_m`` and so on; None where unknown."""
        names = LocalisationError.__dataclass_fields__
        errors = {name: None if self.error is None else getattr(self.error, name) for name in names}
        own = {name: value for name, value in vars(self).items() if name not in ("error", "left_out")}
        return {**own, **errors}


def measure_matcher(
    keypoints: abc.Sequence[Keypoints],
    matches: abc.Iterable[Matches],
    tracks: Tracks,
    sequence: Sequence,
    read_truth: abc.Callable[[int], FrameTruth] | None = None,
) -> MatcherQuality:
    """Measure the quality of the features, matches and tracks of a run held in memory.

    Args:
        keypoints: one set a frame.
        matches: those that passed the filters, of any frame pairs, frame_a before frame_b. Frame pairs without matches
            count for the recall.
        tracks: of these keypoints.
        sequence: sonar and, where known, true poses.
        read_truth: returns the true elevations of a frame, from a simulation; not used where a frame has no true pose.

    Raises:
        AsfmError: the truth of a frame cannot be read.
    """
    listed, read_truth = list(matches), usable_truth(sequence, read_truth)
    return summarise_matcher(
        measure_pairs(keypoints, listed, sequence, read_truth), keypoints, listed, tracks, sequence, read_truth
    )


def summarise_matcher(
    pairs: abc.Sequence[PairStatistics],
    keypoints: abc.Sequence[Keypoints],
    matches: abc.Sequence[Matches],
    tracks: Tracks,
    sequence: Sequence,
    read_truth: abc.Callable[[int], FrameTruth] | None,
) -> MatcherQuality:
    """Measure as :func:`measure_matcher`, from the statistics of the frame pairs."""
    posed = sequence.groundtruth is not None
    world_from_sonar = interpolate_groundtruth(sequence) @ sequence.vehicle_from_sonar if posed else None
    pooled = pool_statistics(pairs, sequence.sonar)
    found = measure_tracks(tracks, sequence.sonar, world_from_sonar, read_truth)
    coverage = measure_coverage(keypoints, matches, sequence.sonar)
    return MatcherQuality(
        matches=sum(len(pair) for pair in matches),
        precision=pooled.precision,
        recall=pooled.recall,
        arc_inlier_ratio=pooled.arc_inlier_ratio,
        error=pooled.error,
        tracks=found.tracks,
        track_length=found.mean_length,
        track_length_median=found.median_length,
        track_purity=found.purity,
        keypoint_coverage=None if coverage is None else coverage.keypoints,
        match_coverage=None if coverage is None else coverage.matches,
        left_out=(*(() if posed else NEEDS_POSES), *(() if posed and read_truth is not None else NEEDS_ELEVATIONS)),
    )


def usable_truth(
    sequence: Sequence, read_truth: abc.Callable[[int], FrameTruth] | None
) -> abc.Callable[[int], FrameTruth] | None:
    """Return the reader of true elevations where the true pose of every frame is known, and None elsewhere."""
    if read_truth is None or sequence.groundtruth is None:
        return None
    known = within_reach(sequence.timestamps_s, sequence.groundtruth.timestamps_s)
    return read_truth if known.all() else None
