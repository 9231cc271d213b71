"""Configuration: every setting of a run, with its default and unit. An unknown key is an error that names the key."""

from typing import Any, ClassVar, Literal

from pydantic import BaseModel, ConfigDict, Field, model_validator

from asfm.errors import quote

Filter = Literal["mutual", "ratio", "ssl", "arc", "planar", "clique"]
"""The outlier filters of asfm.frontend.matching.filters."""
MAX_PATCH_RADIUS_PX = 40
"""Patches of all keypoints are kept: half a gigabyte for a hundred frames."""
MAX_WINDOW_PX = 500
"""Half-size of a CFAR window."""
Scene = Literal["unknown", "below", "above"]
"""Where the scene lies relative to an upright sonar."""


class Section(BaseModel):
    """A group of settings that belong to one stage."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)
    RENAMED: ClassVar[dict[str, str]] = {}
    """Keys of the release before, with their present names."""

    @model_validator(mode="before")
    @classmethod
    def _accept_renamed(cls, values: Any) -> Any:
        if not isinstance(values, dict):
            return values
        return {cls.RENAMED.get(key, key) if isinstance(key, str) else key: value for key, value in values.items()}


class CfarConfig(Section):
    """Constant false-alarm rate (CFAR) detection: pixels that exceed a threshold set by their surroundings."""

    false_alarm_probability: float = Field(default=0.05, ge=1e-15, lt=1)
    guard_px: tuple[int, int] = (4, 4)
    """Half-size (rows, columns) of the guard window around the cell under test."""
    reference_px: tuple[int, int] = (16, 12)
    """Half-size (rows, columns) of the reference window; larger than the guard window in at least one of the two. Zero
    columns in both make the windows one-dimensional, along range."""
    method: Literal["ca", "goca", "soca", "os"] = "ca"
    """Statistic of the reference cells: their mean (CA), the greater (GOCA) or smaller (SOCA) mean of the leading and
    lagging cells, or an order statistic (OS)."""
    noise: Literal["rayleigh", "exponential", "weibull"] = "weibull"
    """Distribution of the background: of an amplitude image, of a power image, or Weibull clutter whose shape is
    estimated from each image, for recordings with unknown dynamic-range compression."""
    order_fraction: float = Field(default=0.75, ge=1e-6, le=1)
    """Rank of the order statistic of the method "os", as a share of the reference cells."""

    @model_validator(mode="after")
    def _check_windows(self) -> "CfarConfig":
        windows = list(zip(self.guard_px, self.reference_px, strict=True))
        if not all(0 <= guard <= reference for guard, reference in windows) or self.guard_px == self.reference_px:
            raise ValueError(
                "expected 0 <= guard_px <= reference_px in rows and in columns, and not the same in both, "
                f"found guard_px {list(self.guard_px)} and reference_px {list(self.reference_px)}"
            )
        if max(self.reference_px) > MAX_WINDOW_PX:
            raise ValueError(f"expected reference_px of {MAX_WINDOW_PX} at most, found {max(self.reference_px):.6g}")
        return self


class DbscanConfig(Section):
    """DBSCAN clustering of the detected pixels: isolated detections are noise."""

    radius_px: float = Field(default=3.0, gt=0, le=100)
    min_pixels: int = Field(default=10, ge=1, le=1_000_000)
    """Detections within the radius, the pixel itself included, that make a core point."""


class KeypointsConfig(Section):
    """Feature detection on the image warped to near-square pixels, or on the Cartesian (fan) image."""

    detector: Literal["akaze", "orb", "sift", "brisk"] = "akaze"
    space: Literal["polar", "fan"] = "polar"
    """The image that features are detected in; their coordinates are polar in either case."""
    upright: bool = True
    """Describe features without their orientation: a sonar image shifts along bearing when the vehicle yaws. Not
    available with brisk."""
    threshold: float | None = Field(default=None, ge=1e-12, le=1e6)
    """Detection threshold in the detector's own unit; by default akaze 5e-4, sift 0.02, orb 5, brisk 5."""
    smoothing_px: float = Field(default=2.0, ge=0, le=100)
    """Sigma of the Gaussian that suppresses speckle before detection."""
    min_count: int = Field(default=30, ge=0, le=10_000)
    """Where akaze finds fewer above its threshold, the strongest above a fifth of it are added up to this number."""
    max_count: int = Field(default=500, ge=1, le=10_000)
    """The strongest are kept."""
    margin_px: int = Field(default=4, ge=0, le=1000)
    """Dilation of the echo mask, in pixels of the polar image."""
    max_stretch: float = Field(default=4.0, ge=1, le=32)
    """Largest factor by which the bearing axis is stretched."""


class MatchingConfig(Section):
    """Matching of descriptors over a window of frame gaps, and the outlier filters."""

    max_gap: int = Field(default=8, ge=1, le=10_000)
    """Each frame is matched with the frames 1..max_gap before it."""
    filters: tuple[Filter, ...] = ("mutual", "ratio", "arc", "planar", "ssl")
    """The outlier filters in their order, each applied to what passed those before. arc needs predicted poses."""
    guided: bool = False
    """With predicted poses, compare only keypoints near the elevation arc. It finds a tenth more correct matches over
    large gaps, but they are biased towards the prediction's drift, and poses with depth and attitude got worse."""
    ratio: float = Field(default=0.9, ge=1e-6, le=1)
    """Largest ratio of the nearest to the second-nearest descriptor distance (Lowe 2004)."""
    arc_gate: float = Field(default=3.0, ge=1e-6, le=1e6)
    """Largest distance of a match from its elevation arc, in sigmas that include those of the predicted poses."""
    planar_tolerance: float = Field(default=0.025, ge=1e-9, le=10)
    """Largest distance of an inlier from the planar motion, over its range; at least its noise."""

    @model_validator(mode="after")
    def _check_filters(self) -> "MatchingConfig":
        if len(set(self.filters)) < len(self.filters):
            raise ValueError(f"expected each filter at most once in filters, found {quote(list(self.filters))}")
        return self


class TracksConfig(Section):
    """Association: matches consistent with the current poses, joined into tracks."""

    gate_factor: float = Field(default=3.5, ge=1e-6, le=1e6)
    """Gate on the distance from the elevation arc, over the median distance."""
    min_gate: float = Field(default=2.0, ge=1e-6, le=1e6)
    """Smallest gate, in sigmas."""
    min_views: int = Field(default=3, ge=2, le=10_000)
    """Shorter tracks are discarded."""
    window: int = Field(default=16, ge=0, le=10_000)
    """Guided matching: largest number of frames from a track's observations to a frame it may grow into; 0: none."""
    settled_share: float = Field(default=0.2, ge=0, le=1)
    """The rounds end when a smaller share of the observations than this is new or gone."""


class NoiseConfig(Section):
    """Standard deviations of a feature's position for gates, and for weights where a match states none.

    They hold where too few matches of neighbouring frames tell the noise; elsewhere it is estimated from these.
    """

    estimated: bool = True
    """Estimate the noise from matches of neighbouring frames; false: as stated here."""
    range_bins: float = Field(default=1.5, ge=1e-6, le=1e4)
    bearing_beams: float = Field(default=1.0, ge=1e-6, le=1e4)
    min_bearing_deg: float = Field(default=0.3, ge=0, le=180)
    """Lower bound for sonars that sample beams more finely than they resolve them."""


class SslConfig(Section):
    """The structural-and-spatial loss (SSL) of the patches of a match."""

    radius_px: int = Field(default=7, ge=1, le=MAX_PATCH_RADIUS_PX)
    structural_weight: float = Field(default=1.0, ge=0, le=1e6)
    spatial_weight: float = Field(default=1.0, ge=0, le=1e6)
    max_loss: float = Field(default=0.3, ge=1e-9, le=1e6)


class LocalisationConfig(Section):
    """Patch alignment of matches: standard deviation of each match, and rejection of unlocalised ones."""

    RENAMED: ClassVar[dict[str, str]] = {"spread_factor": "sigma_scale"}

    radius_px: int = Field(default=14, ge=0, le=MAX_PATCH_RADIUS_PX)
    """Half-size of the patches that are aligned; 0: no alignment, default sigmas."""
    floor_px: float | None = Field(default=None, ge=1e-6, le=1000)
    """Smallest standard deviation of a feature's position, in pixels of the image that features are detected in; by
    default the measured one of the detector: akaze and sift 0.7, orb 0.8, brisk 0.9."""
    sigma_scale: float = Field(default=1.5, ge=1e-6, le=1000)
    """Factor on the standard deviation that the alignment itself states."""
    max_sigma_px: float = Field(default=1.9, ge=1e-6, le=1e4)
    """Matches with a larger standard deviation (aperture problem: unconstrained along an edge) are rejected."""


class BackendConfig(Section):
    """Triangulation and bundle adjustment."""

    use_odometry: bool = True
    use_navigation: bool = True
    """Use depth and attitude."""
    rounds: int = Field(default=5, ge=1, le=1000)
    """Largest number of rounds of association and optimisation; see ``tracks.settled_share``."""
    max_views: int = Field(default=20, ge=3, le=10_000)
    """A landmark with more observations keeps the most informative ones."""
    estimate_lever_rotation: bool = False
    """Estimate the rotation of the sonar's mounting relative to the given one: about thirty more adjustments."""
    estimate_range_bias: bool = False
    """Estimate a constant range bias: about ten more adjustments."""
    track_correlation: float = Field(default=0.7, ge=0, le=1)
    """Correlation of the errors of one track's observations, as features slide along edges. Autocorrelation that decays
    from frame to frame is estimated in addition."""
    elevation_correlation: float = Field(default=0.3, ge=0, le=1)
    """The same for the information on a landmark's elevation, which comes from changes of range and bearing, where
    common errors cancel. It enters the covariances of landmarks."""
    motion_prior_factor: float = Field(default=1.5, ge=1e-6, le=1e6)
    """Without odometry: sigma of the motion prior, over the typical step of the planar odometry."""
    scene: Scene = "unknown"
    """Where the scene lies, below or above the plane of an upright sonar. It resolves the mirror ambiguity where there
    is no odometry, depth or attitude."""
    well_constrained_share: float = Field(default=0.4, ge=1e-6, le=100)
    """A landmark is well constrained when its sigma is below this share of half its elevation arc. The aperture alone
    gives 0.58."""


class LoopsConfig(Section):
    """Loop closure: pairs of frames beyond the matching window that see the same place."""

    RENAMED: ClassVar[dict[str, str]] = {"min_likeness": "min_similarity"}

    enabled: bool = True
    sigma_factor: float = Field(default=3.0, ge=1e-6, le=1000)
    """Factor on the poses' standard deviations in the search for candidates."""
    min_overlap: float = Field(default=0.3, ge=1e-6, le=1)
    """Smallest share of a frame's frustum that the other frame sees, or may see."""
    max_shared: int = Field(default=8, ge=0, le=1_000_000)
    """Pairs of frames that share more landmarks are connected already."""
    max_pairs: int = Field(default=80, ge=1, le=1_000_000)
    """Largest number of candidate pairs that are matched, without the neighbours that support them."""
    min_similarity: float = Field(default=0.4, ge=0, le=1)
    """Smallest similarity of the frames' place descriptors, 0 to 1."""
    min_matches: int = Field(default=6, ge=4, le=10_000)
    """Smallest number of matches that agree on one motion."""
    max_log_alarms: float = Field(default=-6.0, ge=-1e6, le=0)
    """Largest log10 of the number of false alarms of a pair accepted by itself."""
    max_rivals: float = Field(default=0.5, ge=1e-6, le=1)
    """A pair is ambiguous when this share of its matches agrees on a competing motion."""
    min_coverage: float = Field(default=0.5, ge=0, le=1)
    """Smallest share of the keypoints that both frames should see with a match nearby."""
    max_conflicts: float = Field(default=0.2, ge=0, le=1)
    """Largest share of the matches that join landmarks which one frame sees apart."""


class FramesConfig(Section):
    """Part of a recording that is used; everything in the results is numbered within it."""

    first: int = Field(default=0, ge=0, le=1_000_000_000)
    """Number of the first frame."""
    last: int | None = Field(default=None, ge=0, le=1_000_000_000)
    """Number of the last frame, included; the last of the recording where it is null."""
    every: int = Field(default=1, ge=1, le=1_000_000_000)
    """Take every n-th frame from the first on."""


class Config(Section):
    """The whole configuration of a run."""

    seed: int = Field(default=0, ge=0, lt=2**63)
    mode: Literal["batch"] = "batch"
    frames: FramesConfig = FramesConfig()
    cfar: CfarConfig = CfarConfig()
    clusters: DbscanConfig = DbscanConfig()
    keypoints: KeypointsConfig = KeypointsConfig()
    matching: MatchingConfig = MatchingConfig()
    ssl: SslConfig = SslConfig()
    tracks: TracksConfig = TracksConfig()
    localisation: LocalisationConfig = LocalisationConfig()
    noise: NoiseConfig = NoiseConfig()
    backend: BackendConfig = BackendConfig()
    loops: LoopsConfig = LoopsConfig()

    @property
    def patch_radius_px(self) -> int:
        """Half-size of the patches cut around keypoints: the largest that any stage uses."""
        return max(self.ssl.radius_px, self.localisation.radius_px)
