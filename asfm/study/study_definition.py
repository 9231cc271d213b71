"""Study file: sequences, seeds, matchers, filter chains, sensor modes and corruption of a study, as YAML."""

from pathlib import Path
from typing import Annotated, Any, Literal, get_args

from pydantic import BaseModel, ConfigDict, Field, ValidationError, field_validator, model_validator

from asfm.config import Filter, MatchingConfig
from asfm.errors import AsfmError, quote, shorten
from asfm.safe_yaml import read_yaml

Mode = Literal["sonar", "odometry", "all"]
"""Sensors in use: the sonar alone, the sonar with odometry, or with odometry, depth and attitude."""
Detector = Literal["akaze", "orb", "sift", "brisk"]
LearnedMatcher = Literal["aliked_lightglue", "disk_lightglue", "xfeat"]
Name = Annotated[str, Field(pattern=r"^[^\x00-\x1f\x7f=@$\\`|<>][^\x00-\x1f\x7f$\\`|<>]{0,59}$")]
Share = Annotated[float, Field(ge=0, le=1)]
Seed = Annotated[int, Field(ge=0, lt=2**31)]
MAX_CELLS = 20_000


class _Part(BaseModel):
    """A group of keys of the study file; an unknown key is an error."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


class SimulationGrid(_Part):
    """Sequences to simulate: every scene before every sonar with every motion."""

    scenes: tuple[str, ...] = Field(min_length=1)
    sonars: tuple[str, ...] = ("oculus_m750d_high",)
    """Presets, or HoloOcean scenarios (.json) relative to the study file."""
    motions: tuple[str | None, ...] = (None,)
    """Names of motions; null for the scene's usual one."""
    scene_seeds: tuple[Seed, ...] = (0,)
    """Seeds of the scene and of the motion, which the seeds of the study do not change."""
    frames: int = Field(default=80, ge=2, le=100_000)


class ExternalSettings(_Part):
    """An external matcher: files in hloc's layout, or a Python function, which is run."""

    name: Name
    features: str | None = None
    """features.h5, relative to the study file."""
    matches: str | None = None
    """matches.h5, relative to the study file."""
    sequence: str | None = None
    """Name of the sequence that the files are of; all recordings where it is null."""
    function: str | None = Field(default=None, pattern=r"^[A-Za-z_][\w.]*:[A-Za-z_]\w*$")
    """``module:function``, called with two images."""

    @model_validator(mode="after")
    def _check_kind(self) -> "ExternalSettings":
        files = (self.features is not None, self.matches is not None)
        if files[0] != files[1] or files[0] == (self.function is not None):
            raise ValueError("expected either features and matches, or function (module:function)")
        return self


class CorruptionSettings(_Part):
    """Dials of the controlled corruption of true matches; each is a list of values."""

    wrong_share: tuple[Annotated[float, Field(ge=0, le=0.95)], ...] = Field(default=(0.0,), min_length=1)
    """Share of the matches whose partner is swapped for a wrong one."""
    wrong_kind: tuple[Literal["random", "look-alike"], ...] = Field(default=("random",), min_length=1)
    """Partner of a wrong match: that of any other match of the two frames, or of the one nearest in the image."""
    range_noise_bins: tuple[Annotated[float, Field(ge=0, le=100)], ...] = Field(default=(0.5,), min_length=1)
    """Standard deviation of a keypoint's range, in range bins."""
    bearing_noise_beams: tuple[Annotated[float, Field(ge=0, le=100)], ...] = Field(default=(0.5,), min_length=1)
    """Standard deviation of a keypoint's bearing, in beams."""
    noise_kind: tuple[Literal["white", "track"], ...] = Field(default=("white",), min_length=1)
    """Errors independent from frame to frame, or the same along a track."""
    recall: tuple[Annotated[float, Field(gt=0, le=1)], ...] = Field(default=(1.0,), min_length=1)
    """Share of the true matches that are kept."""
    track_length: tuple[Annotated[int, Field(ge=2, le=100_000)] | None, ...] = Field(default=(None,), min_length=1)
    """Longest track in frames; null for no limit."""
    design: Literal["one-at-a-time", "product"] = "one-at-a-time"
    """Vary one dial while the others have their first value, or combine all values."""
    points: int = Field(default=100, ge=4, le=5000)
    """True points in view of a frame, as far as the scene provides them."""


def _no_changes() -> dict[str, dict[str, Any]]:
    return {"default": {}}


class StudyDefinition(_Part):
    """The content of a study file."""

    name: Name = "study"
    sequences: tuple[str, ...] = ()
    """Folders or recordings, relative to the study file."""
    simulate: SimulationGrid | None = None
    seeds: tuple[Seed, ...] = Field(default=(0,), min_length=1)
    """Seeds, or their number."""
    modes: tuple[Mode, ...] = Field(default=("all",), min_length=1)
    detectors: tuple[Detector, ...] = ()
    learned: tuple[LearnedMatcher, ...] = ()
    """Pretrained matchers of the extra ``learned``."""
    filters: dict[Name, tuple[Filter, ...]] = Field(
        default_factory=lambda: {"default": MatchingConfig().filters}, min_length=1
    )
    """Named chains of outlier filters."""
    external: tuple[ExternalSettings, ...] = ()
    backend: dict[Name, dict[str, Any]] = Field(default_factory=_no_changes, min_length=1)
    """Named changes of the configuration, as in a file for ``--config``."""
    corruption: CorruptionSettings | None = None
    bound_draws: int = Field(default=3, ge=0, le=100)
    """Draws of the noise for the bound of simulated sequences; 0: no bound, and no ATE over it."""

    @field_validator("seeds", mode="before")
    @classmethod
    def _count_seeds(cls, value: Any) -> Any:
        if isinstance(value, int) and not isinstance(value, bool):
            if not 1 <= value <= MAX_CELLS:
                raise ValueError(f"expected their number, 1 to {MAX_CELLS}, or a list of them")
            return tuple(range(value))
        if value == []:
            raise ValueError("expected one seed or more")
        return value


def read_study(path: Path) -> StudyDefinition:
    """Read a study file.

    Raises:
        AsfmError: the file cannot be read, a key is unknown, a value is invalid, or nothing is listed to be studied.
    """
    content = read_yaml(path, "the study")
    if not isinstance(content, dict):
        raise AsfmError(f"{path}: expected the keys of a study ({_list_keys(StudyDefinition)}), found {quote(content)}")
    try:
        study = StudyDefinition.model_validate(content)
    except ValidationError as error:
        raise AsfmError(f"{path}: {_describe_fault(error)}") from None
    if not study.sequences and study.simulate is None:
        raise AsfmError(f"{path}: expected sequences, or scenes to simulate, found neither: the grid is empty")
    if not any((study.detectors, study.learned, study.external, study.corruption)):
        raise AsfmError(
            f"{path}: expected detectors, learned or external matchers, or corruption, found none: the grid is empty"
        )
    if study.corruption is not None and study.simulate is None:
        raise AsfmError(f"{path}: corruption needs true points: expected scenes to simulate, found none")
    _check_repeated(path, study)
    return study


def _check_repeated(path: Path, study: StudyDefinition) -> None:
    """Check that no value is listed twice: its cells would be the same."""
    names = tuple(matcher.name for matcher in study.external)
    lists = {"sequences": study.sequences, "seeds": study.seeds, "modes": study.modes, "detectors": study.detectors}
    lists |= {"learned": study.learned, "external": names}
    for part in (study.simulate, study.corruption):
        if part is not None:
            lists.update({key: value for key, value in vars(part).items() if isinstance(value, tuple)})
    for key, values in lists.items():
        repeated = next((value for number, value in enumerate(values) if value in values[:number]), None)
        if len(set(values)) < len(values):
            raise AsfmError(f"{path}: expected each value of {key} once, found {quote(repeated)} again")
    taken = set(names) & {*get_args(Detector), *get_args(LearnedMatcher)}
    if taken:
        raise AsfmError(
            f"{path}: expected names of external matchers other than those of asfm, found {sorted(taken)[0]}"
        )


def _describe_fault(error: ValidationError) -> str:
    first = error.errors(include_url=False, include_context=False)[0]
    name = quote(".".join(str(part) for part in first["loc"]))
    if first["type"] == "extra_forbidden":
        return f"unknown key {name} in the study; known here: {_list_keys(_find_model(first['loc'][:-1]))}"
    message = shorten(first["msg"].removeprefix("Value error, "), 200)
    return f"key {name} of the study: {message}, found {quote(first['input'])}"


def _find_model(location: tuple[int | str, ...]) -> type[BaseModel]:
    parts: dict[int | str, type[BaseModel]] = {
        "simulate": SimulationGrid,
        "external": ExternalSettings,
        "corruption": CorruptionSettings,
    }
    return parts.get(location[0], StudyDefinition) if location else StudyDefinition


def _list_keys(model: type[BaseModel]) -> str:
    return ", ".join(sorted(model.model_fields))
