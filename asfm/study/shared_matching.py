"""Shared matching: features and candidates of all cells that have them in common, found in one pass over the images."""

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from asfm.config import BackendConfig, Config, Filter, NoiseConfig
from asfm.navigation.frame_navigation import read_navigation
from asfm.navigation.local_world import move_to_local_origin
from asfm.navigation.pose_prediction import PosePrediction, predict_poses
from asfm.pipeline.chain_matching import FilterChain, extract_chains
from asfm.pipeline.feature_matching import extract_matches
from asfm.pipeline.noise_estimation import estimate_noise
from asfm.recorder import Recorder
from asfm.results.json_file import write_json
from asfm.safe_json import read_json
from asfm.sequence import Sequence
from asfm.stages import StageClock
from asfm.study.cell import Cell
from asfm.study.feature_cache import StudyCache
from asfm.study.fingerprint import hash_content
from asfm.study.match_files import read_keypoints, read_matches, write_keypoints, write_matches
from asfm.types import ExternalMatches, Keypoints, Matches

KEYPOINTS, NOISE = "keypoints.npz", "noise.json"


@dataclass(frozen=True)
class MatchRequest:
    """What a cell needs of the shared features: its filters, and the sensors that predict the poses for them."""

    filters: tuple[Filter, ...]
    backend: BackendConfig


def list_requests(cells: Iterable[Cell]) -> dict[str, tuple[MatchRequest, ...]]:
    """Return what the cells of each features key need, without repetition; cells with external matches need nothing."""
    found: dict[str, dict[MatchRequest, None]] = {}
    for cell in cells:
        if cell.external is None and cell.corruption is None:
            request = MatchRequest(cell.config.matching.filters, cell.config.backend)
            found.setdefault(cell.features_key, {})[request] = None
    return {key: tuple(requests) for key, requests in found.items()}


@dataclass(frozen=True)
class StoredMatches:
    """Features and matches of a sequence that were found before, as the front-end of the pipeline."""

    folder: Path
    sequence: Sequence
    noise: NoiseConfig
    """Of the features, as it was estimated before they were matched."""

    def extract(
        self,
        sequence: Sequence,
        config: Config,
        recorder: Recorder,
        clock: StageClock,
        prediction: PosePrediction | None,
        external: ExternalMatches | None,
    ) -> tuple[list[Keypoints], list[Matches]]:
        """Read what was stored; what was not, as after images were turned, is computed."""
        path = self.folder / _name(config.matching.filters, prediction)
        if external is not None or sequence.read_frame is not self.sequence.read_frame or not path.is_file():
            return extract_matches(sequence, config, recorder, clock, prediction, external)
        return read_keypoints(self.folder / KEYPOINTS), read_matches(path)


def provide_matches(
    cell: Cell, sequence: Sequence, requests: Iterable[MatchRequest], cache: StudyCache
) -> StoredMatches:
    """Return the stored matches of a cell's features, found first where that has not been done.

    Args:
        cell: gives the configuration of the front-end.
        sequence: its sequence.
        requests: of all cells that share the features, this one's among them.
        cache: of the study.

    Raises:
        AsfmError: a frame cannot be read.
    """

    def write(folder: Path) -> None:
        config, chains = estimate_noise(sequence, cell.config, StageClock()), dict[str, FilterChain]()
        for request in requests:
            local, _ = move_to_local_origin(sequence, request.backend)
            prediction = predict_poses(read_navigation(local, request.backend), local)
            chains.setdefault(_name(request.filters, prediction), FilterChain(request.filters, prediction))
        keypoints, found = extract_chains(sequence, config, list(chains.values()))
        write_json(folder / NOISE, config.noise.model_dump(mode="json"))
        write_keypoints(folder / KEYPOINTS, keypoints)
        for name, matches in zip(chains, found, strict=True):
            write_matches(folder / name, matches)

    folder = cache.provide("features", cell.features_key, write)
    noise = NoiseConfig.model_validate(read_json(folder / NOISE, "the noise of features"))
    return StoredMatches(folder, sequence, noise)


def _name(filters: tuple[Filter, ...], prediction: PosePrediction | None) -> str:
    """Return the name of the file of a filter chain under predicted poses."""
    poses = None if prediction is None else prediction.world_from_sonar.tobytes().hex()
    return f"matches-{hash_content([filters, poses])}.npz"
