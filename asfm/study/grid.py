"""Grid of a study: its cells in their order, and an estimate of their time."""

from collections.abc import Collection, Iterator, Sequence
from dataclasses import replace
from importlib.metadata import version
from itertools import product
from pathlib import Path
from typing import Any

from asfm.config import Filter
from asfm.datasets import open_sequence
from asfm.errors import AsfmError, quote
from asfm.frontend.matching.external_matches import DESCRIPTOR_FILTERS
from asfm.learned.weights import LIBRARIES, PACKAGES, check_extra
from asfm.regular_file import check_file
from asfm.study.cell import Cell, Corruption, External, Recording, Simulation
from asfm.study.cell_config import MODE_SETTINGS, Sections, corruption_sections, make_config
from asfm.study.fingerprint import hash_content, hash_function, hash_path
from asfm.study.study_definition import (
    MAX_CELLS,
    CorruptionSettings,
    ExternalSettings,
    LearnedMatcher,
    Mode,
    SimulationGrid,
    StudyDefinition,
)

TRUE_MATCHES, NO_FILTERS = "true matches", "none"
"""Names of the matcher and of the filter chain of cells with corrupted true matches."""


def build_grid(study: StudyDefinition, folder: Path) -> list[Cell]:
    """List all cells of a study: sequences, seeds, matchers, filter chains, back-ends and modes, the last fastest.

    Args:
        study: the definition.
        folder: of the study file; its paths are relative to it.

    Raises:
        AsfmError: a path does not exist, a name is unknown, a setting is invalid, or there is no or too large a grid.
    """
    recordings = [_open_recording(folder, text) for text in study.sequences]
    sequences: list[Recording | Simulation] = [*recordings, *_list_simulations(study.simulate, folder)]
    names = [sequence.name for sequence in sequences]
    if len(set(names)) < len(names):
        repeated = next(name for number, name in enumerate(names) if name in names[:number])
        raise AsfmError(f"expected sequences of different names, found {quote(repeated)} twice: rename a folder")
    external = [_open_external(folder, settings) for settings in study.external]
    learned = _open_learned(study.learned)
    for settings in study.external:
        if settings.sequence is not None and settings.sequence not in names:
            known = ", ".join(names)
            raise AsfmError(
                f"external matcher {settings.name}: expected a sequence among {known}, found {quote(settings.sequence)}"
            )
    _check_matched(study, recordings)
    cells = []
    for sequence, seed in product(sequences, study.seeds):
        for cell in _list_matchers(study, [*learned, *external], sequence, seed):
            cells.append(cell)
            if len(cells) > MAX_CELLS:
                raise AsfmError(f"expected at most {MAX_CELLS} cells in a study, found more")
    if not cells:
        raise AsfmError("the grid is empty: external matches are of recordings, and corruption of simulated scenes")
    return cells


def list_corruptions(settings: CorruptionSettings) -> list[Corruption]:
    """List the settings of all dials: one dial varied at a time, or their product.

    Every kind of wrong matches is varied over all shares of them.
    """
    dials = {key: value for key, value in vars(settings).items() if isinstance(value, tuple)}
    first = Corruption(**{key: values[0] for key, values in dials.items()}, points=settings.points)
    if settings.design == "product":
        return [replace(first, **dict(zip(dials, values, strict=True))) for values in product(*dials.values())]
    found = [first, *(replace(first, **{key: value}) for key, values in dials.items() for value in values[1:])]
    kinds = [replace(first, wrong_kind=kind) for kind in settings.wrong_kind[1:]]
    found = [one for one in found if one not in kinds or one.wrong_share]  # without wrong ones, their kind is nothing
    return [*found, *(replace(one, wrong_share=share) for one in kinds for share in settings.wrong_share[1:])]


def _list_matchers(
    study: StudyDefinition, external: list[External], sequence: Recording | Simulation, seed: int
) -> Iterator[Cell]:
    """List the cells of one sequence and seed."""
    ends = list(product(study.backend.items(), study.modes))

    def make(matcher: str, chain: str, changes: Sections, end: tuple[tuple[str, Any], Mode], **more: Any) -> Cell:
        (backend, own), mode = end
        sections = {**changes, "backend": {**changes.get("backend", {}), **MODE_SETTINGS[mode]}}
        config = make_config(backend, own, sections, seed)
        return Cell(sequence, seed, mode, matcher, chain, backend, config, study.bound_draws, **more)

    for detector, (chain, filters), end in product(study.detectors, study.filters.items(), ends):
        yield make(detector, chain, {"keypoints": {"detector": detector}, "matching": {"filters": filters}}, end)
    files_of = {settings.name: settings.sequence for settings in study.external if settings.function is None}
    for matcher in external:
        if matcher.name in files_of and (
            isinstance(sequence, Simulation) or files_of[matcher.name] not in (None, sequence.name)
        ):
            continue
        for (chain, filters), end in product(_list_external_chains(study), ends):
            yield make(matcher.name, chain, {"matching": {"filters": filters}}, end, external=matcher)
    if study.corruption is not None and isinstance(sequence, Simulation):
        for corruption, end in product(list_corruptions(study.corruption), ends):
            yield make(TRUE_MATCHES, NO_FILTERS, corruption_sections(corruption), end, corruption=corruption)


def _list_external_chains(study: StudyDefinition) -> list[tuple[str, tuple[Filter, ...]]]:
    """Return the chains that differ without the filters on descriptors, which external matches do not have."""
    found: dict[tuple[Filter, ...], str] = {}
    for name, filters in study.filters.items():
        found.setdefault(tuple(filter_name for filter_name in filters if filter_name not in DESCRIPTOR_FILTERS), name)
    return [(name, filters) for filters, name in found.items()]


def _open_recording(folder: Path, text: str) -> Recording:
    path = (folder / text).resolve()
    open_sequence(path)
    return Recording(path.name, path, hash_path(path))


def _list_simulations(grid: SimulationGrid | None, folder: Path) -> list[Simulation]:
    if grid is None:
        return []
    from asfm.simulation.scenes.catalogue import SCENES, find_scene
    from asfm.simulation.simulate import find_sonar
    from asfm.simulation.vehicle.trajectories import find_motion

    sonars = [str((folder / sonar).resolve()) if sonar.endswith(".json") else sonar for sonar in grid.sonars]
    scenes = [str((folder / scene).resolve()) if _is_file_name(scene, SCENES) else scene for scene in grid.scenes]
    for sonar in sonars:
        find_sonar(sonar)
    for scene in scenes:
        find_scene(scene)
    for motion in grid.motions:
        if motion is not None:
            find_motion(motion)
    contents = {sonar: hash_path(Path(sonar)) if sonar.endswith(".json") else "" for sonar in sonars}
    meshes = {scene: "" if scene in SCENES else _hash_mesh(Path(scene)) for scene in scenes}
    return [
        Simulation(scene, sonar, motion, scene_seed, grid.frames, contents[sonar], meshes[scene])
        for scene, sonar, motion, scene_seed in product(scenes, sonars, grid.motions, grid.scene_seeds)
    ]


def _hash_mesh(path: Path) -> str:
    check_file(path, "a mesh")
    return hash_path(path)


def _is_file_name(scene: str, known: Collection[str]) -> bool:
    return scene not in known and bool(Path(scene).suffix)


def _open_learned(names: Sequence[LearnedMatcher]) -> list[External]:
    """Return the learned matchers, with the versions of their libraries and weights as fingerprint."""
    if names:
        check_extra()
    installed = {name: version(name.replace("_", "-")) for name in (*LIBRARIES, *PACKAGES)} if names else {}
    return [External(name, hash_content([name, installed]), learned=True) for name in names]


def _open_external(folder: Path, settings: ExternalSettings) -> External:
    if settings.function is not None:
        return External(settings.name, hash_function(settings.function), function=settings.function)
    features, matches = (folder / str(settings.features)).resolve(), (folder / str(settings.matches)).resolve()
    for path in (features, matches):
        check_file(path, "an HDF5 file")
    return External(settings.name, hash_content([hash_path(features), hash_path(matches)]), features, matches)


def _check_matched(study: StudyDefinition, recordings: list[Recording]) -> None:
    """Check that files of external matches say which of several recordings they are of."""
    for settings in study.external:
        if settings.function is None and settings.sequence is None and len(recordings) > 1:
            names = ", ".join(recording.name for recording in recordings)
            raise AsfmError(f"external matcher {settings.name}: expected the key sequence, one of {names}, found none")
