"""Every setting of a run, with its default and unit. An unknown key is an error that names the key."""

from typing import Literal

from pydantic import BaseModel, ConfigDict, Field, model_validator

Filter = Literal["mutual", "ratio", "ssl", "arc", "planar", "clique"]
"""The outlier filters of asfm.frontend.matching.filters."""
Scene = Literal["unknown", "below", "above"]
"""Where a scene lies, seen from an upright sonar."""


class Section(BaseModel):
    """A group of settings that belong to one stage."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


class CfarConfig(Section):
    """Constant false-alarm rate detection: which pixels stand out from their surroundings."""

    false_alarm_probability: float = Field(default=0.05, gt=0, lt=1)
    guard_px: tuple[int, int] = (4, 4)
    """Half-size (rows, columns) of the guard window around the cell under test."""
    reference_px: tuple[int, int] = (16, 12)
    """Half-size (rows, columns) of the reference window; larger than the guard window in one of the two at least. No
    columns in both make the windows one-dimensional, along range."""
    method: Literal["ca", "goca", "soca", "os"] = "ca"
    """Statistic of the reference cells: their mean, the greater or the smaller mean of the nearer and the farther ones,
    or the cell of a certain rank."""
    noise: Literal["rayleigh", "exponential", "weibull"] = "weibull"
    """What empty water looks like in the image: amplitude, power, or a power of them that each image tells of itself,
    for recordings that were compressed nobody knows how."""
    order_fraction: float = Field(default=0.75, gt=0, le=1)
    """Rank that the method "os" takes, as a share of the reference cells."""

    @model_validator(mode="after")
    def _check_windows(self) -> "CfarConfig":
        windows = list(zip(self.guard_px, self.reference_px, strict=True))
        if not all(0 <= guard <= reference for guard, reference in windows) or self.guard_px == self.reference_px:
            raise ValueError(
                "expected 0 <= guard_px <= reference_px in rows and in columns, and not the same in both, "
                f"found guard_px {list(self.guard_px)} and reference_px {list(self.reference_px)}"
            )
        return self


class DbscanConfig(Section):
    """DBSCAN on the detected pixels: lone detections are noise."""

    radius_px: float = Field(default=3.0, gt=0)
    min_pixels: int = Field(default=10, ge=1)
    """Detections within the radius, the pixel itself included, that make a core."""


class KeypointsConfig(Section):
    """Features of the image stretched to near-square pixels, or drawn as a fan."""

    detector: Literal["akaze", "orb", "sift", "brisk"] = "akaze"
    space: Literal["polar", "fan"] = "polar"
    """The picture in which features are looked for; their coordinates are polar in either case."""
    upright: bool = True
    """Describe features without their direction: a sonar image shifts along the bearing when the vehicle turns.
    BRISK cannot."""
    threshold: float | None = Field(default=None, gt=0)
    """In the detector's own unit; without one akaze takes 5e-4, sift 0.02, orb 5 and brisk 5."""
    smoothing_px: float = Field(default=2.0, ge=0)
    """Sigma of the Gaussian that calms the speckle before detection."""
    min_count: int = Field(default=30, ge=0)
    """Where fewer pass the threshold of akaze, the strongest down to a fifth of it fill up."""
    max_count: int = Field(default=500, ge=1)
    """The strongest are kept."""
    margin_px: int = Field(default=4, ge=0)
    """How far the mask reaches beyond the echoes, in pixels of the polar image."""
    max_stretch: float = Field(default=4.0, ge=1)
    """Largest factor by which the bearing axis is stretched."""


class MatchingConfig(Section):
    """Matching of descriptors over a window of frame gaps, and the filters of what it proposes."""

    max_gap: int = Field(default=8, ge=1)
    """Each frame is matched with the frames 1..max_gap before it."""
    filters: tuple[Filter, ...] = ("mutual", "ratio", "arc", "planar", "ssl")
    """Which filters judge, and in which order: each sees what those before it left. arc needs predicted poses."""
    guided: bool = False
    """Where poses are predicted, compare only keypoints near the elevation arc: a tenth more right matches over large
    gaps, but those confirm the prediction's own drift, and poses that depth and attitude hold got worse."""
    ratio: float = Field(default=0.9, gt=0, le=1)
    """Largest distance to the nearest over that to the second nearest."""
    arc_gate: float = Field(default=3.0, gt=0)
    """Under predicted poses a match may lie this many sigmas from its elevation arc, the prediction's included."""
    planar_tolerance: float = Field(default=0.025, gt=0)
    """Farthest that a match may lie from the planar motion that most agree with, over its range; its noise at least."""

    @model_validator(mode="after")
    def _check_filters(self) -> "MatchingConfig":
        if len(set(self.filters)) < len(self.filters):
            raise ValueError(f"expected each filter at most once in filters, found {list(self.filters)}")
        return self


class TracksConfig(Section):
    """Association: matches that the current poses allow, joined into tracks."""

    gate_factor: float = Field(default=3.5, gt=0)
    """A match may lie this many times the typical distance from its elevation arc."""
    min_gate: float = Field(default=2.0, gt=0)
    """The gate is never narrower than this many sigmas."""
    min_views: int = Field(default=3, ge=2)
    """Shorter tracks are left out."""
    window: int = Field(default=16, ge=0)
    """From round to round tracks grow into frames at most so many away that show their points; 0: not at all."""
    settled_share: float = Field(default=0.2, ge=0, le=1)
    """The rounds end when a smaller share of the observations than this is new or gone."""


class NoiseConfig(Section):
    """Standard deviations of a feature's position, which set every gate and weight."""

    range_bins: float = Field(default=1.5, gt=0)
    bearing_beams: float = Field(default=1.0, gt=0)
    min_bearing_deg: float = Field(default=0.3, ge=0)
    """Sonars sample their beams more finely than they resolve them."""


class SslConfig(Section):
    """The structural-and-spatial loss."""

    radius_px: int = Field(default=7, ge=1)
    structural_weight: float = Field(default=1.0, ge=0)
    spatial_weight: float = Field(default=1.0, ge=0)
    max_loss: float = Field(default=0.3, gt=0)


class LocalisationConfig(Section):
    """Where features truly lie, as the patches around them say."""

    radius_px: int = Field(default=14, ge=0)
    """Half-size of the patches that are aligned; 0 leaves features where the detector put them."""
    floor_px: float | None = Field(default=None, gt=0)
    """Standard deviation of the best feature's place, in pixels of the picture that features are found in; without one
    what was measured of the detector: akaze and sift 0.7, orb 0.8, brisk 0.9."""
    sigma_scale: float = Field(default=1.5, gt=0)
    """What an alignment states as its sigma is times this too small."""
    max_sigma_px: float = Field(default=1.9, gt=0)
    """A match less sure than this slides along an edge, or over nothing, and is rejected."""


class BackendConfig(Section):
    """Triangulation and optimisation."""

    use_odometry: bool = True
    use_navigation: bool = True
    rounds: int = Field(default=5, ge=1)
    """How often association and optimisation alternate at most; see ``tracks.settled_share``."""
    max_views: int = Field(default=20, ge=3)
    """A landmark seen more often keeps the observations that inform most."""
    estimate_lever_rotation: bool = False
    """Estimate how the sonar is turned on its mounting, from what is given: takes some thirty adjustments more."""
    estimate_range_bias: bool = False
    """Estimate a constant that every range is too long or too short by: takes some ten adjustments more."""
    track_correlation: float = Field(default=0.7, ge=0, le=1)
    """Correlation of the errors of one track's observations: features slide along edges in step. What fades from frame
    to frame is measured beside it."""
    elevation_correlation: float = Field(default=0.3, ge=0, le=1)
    """The same for what tells a landmark's elevation, which is how range and bearing change: errors in common cancel.
    The sigmas of landmarks are stated with this one."""
    motion_prior_factor: float = Field(default=1.5, gt=0)
    """Without odometry: sigma of a step, over the typical step of the planar motions."""
    scene: Scene = "unknown"
    """Where the scene lies, below or above the plane of an upright sonar. Without odometry, depth and attitude nothing
    else tells a scene from its mirror image."""
    well_constrained_share: float = Field(default=0.4, gt=0)
    """A landmark is well constrained when its sigma is below this share of half its elevation arc. That it lies in the
    beam alone gives 0.58."""


class LoopsConfig(Section):
    """Loop closure: frames beyond the matching window that see the same again, verified before they count."""

    enabled: bool = True
    sigma_factor: float = Field(default=3.0, gt=0)
    """The poses' standard deviations are taken this many times what the graph says of them."""
    min_overlap: float = Field(default=0.3, gt=0, le=1)
    """Share of a frame's frustum that the other frame sees, or may see."""
    max_shared: int = Field(default=8, ge=0)
    """Frames that share more landmarks than this are tied together already."""
    max_pairs: int = Field(default=80, ge=1)
    """Pairs of a whole sequence that are matched, apart from the neighbours that support them."""
    min_similarity: float = Field(default=0.4, ge=0, le=1)
    """Frames whose contexts are less alike, 0 to 1, show different places."""
    min_matches: int = Field(default=6, ge=4)
    """Fewest matches that agree on one motion."""
    max_log_alarms: float = Field(default=-6.0, le=0)
    """Logarithm to base 10 of how many such agreements chance alone may make of a pair that is sure by itself."""
    max_rivals: float = Field(default=0.5, gt=0, le=1)
    """Another motion that this share as many matches agree on makes a pair ambiguous."""
    min_coverage: float = Field(default=0.5, ge=0, le=1)
    """Share of the keypoints that both frames should see with a match nearby: the same place agrees all over."""
    max_conflicts: float = Field(default=0.2, ge=0, le=1)
    """Share of the matches that may join what one frame sees apart from each other."""


class Config(Section):
    """The whole configuration of a run."""

    seed: int = Field(default=0, ge=0)
    mode: Literal["batch"] = "batch"
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
        """Half-size of the patches cut around keypoints: the largest that anyone looks at."""
        return max(self.ssl.radius_px, self.localisation.radius_px)
