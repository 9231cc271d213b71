"""Feature matching of a sequence: mask, keypoints, matches and alignment of each frame; patches freed in time."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from asfm.config import Config
from asfm.pipeline.feature_matching import extract_matches
from asfm.sequence import Sequence
from asfm.stages import StageClock
from asfm.types import Frame, Matches
from tests.pipeline.stubs import Calls, stub_stages
from tests.worlds import make_keypoints, make_vehicle_sequence

FRAMES, MAX_GAP, EXTERNAL_GAP = 7, 2, 4
CONFIG = Config.model_validate({"matching": {"max_gap": MAX_GAP}})


def make_sequence() -> Sequence:
    def read_frame(index: int) -> Frame:
        return Frame(index, float(index), np.full((2, 2), index, np.float32), np.zeros((2, 2), dtype=bool))

    sequence = make_vehicle_sequence()
    return replace(sequence, timestamps_s=sequence.timestamps_s[:FRAMES], read_frame=read_frame)


def run(monkeypatch: pytest.MonkeyPatch, external: Any) -> dict[str, Any]:
    """Extract the matches of a sequence on stand-ins, and note which frames have patches at each step."""
    stub = stub_stages(monkeypatch, "feature_matching")
    with_patches: list[list[int]] = []

    def match(index: int, keypoints: list[Any], name: str) -> list[Matches]:
        with_patches.append([number for number, frame in enumerate(keypoints) if frame.patches.size])
        return [Matches(index - 1, index, np.zeros((1, 2), np.int64), np.zeros(1), filters=(name,))] if index else []

    def keypoints_of(frame: Frame, *_: Any) -> Any:
        return make_keypoints(np.full(1, 1.0 + frame.index), np.zeros(1))

    frames: Calls = []
    pairs: Calls = []
    recorder: Any = SimpleNamespace(
        record_frame=lambda *args: frames.append(args), record_matches=lambda *args: pairs.append(args)
    )
    stub("detect_echo_mask", lambda frame, _: np.full((2, 2), frame.index % 2 == 0))
    made: dict[str, Any] = {"detected": stub("detect_keypoints", keypoints_of), "frames": frames, "pairs": pairs}
    made["cut"] = stub("cut_keypoint_patches", keypoints_of)
    made["matched"] = stub("match_with_previous", lambda index, keypoints, *_: match(index, keypoints, "own"))
    made["filtered"] = stub(
        "filter_external_matches", lambda _, index, keypoints, *__: match(index, keypoints, "given")
    )
    stub("align_matches", lambda matches, *_: [replace(one, filters=(*one.filters, "aligned")) for one in matches])
    prediction: Any = "prediction"
    clock = StageClock()
    made["found"] = extract_matches(make_sequence(), CONFIG, recorder, clock, prediction, external)
    return {**made, "with_patches": with_patches, "counts": clock.reports[0].counts}


def test_keypoints_come_from_the_masked_image_and_matches_are_aligned(monkeypatch: pytest.MonkeyPatch) -> None:
    made = run(monkeypatch, None)
    assert [(call[0].index, bool(call[1].all())) for call in made["detected"]] == [(n, n % 2 == 0) for n in range(7)]
    assert [call[-1] for call in made["matched"]] == ["prediction"] * FRAMES and not made["cut"]
    keypoints, matches = made["found"]
    assert [frame.range_m[0] for frame in keypoints] == [1.0 + n for n in range(FRAMES)]
    assert [(match.frame_a, match.frame_b) for match in matches] == [(n - 1, n) for n in range(1, FRAMES)]
    assert all(match.filters == ("own", "aligned") for match in matches)
    assert made["counts"]["frames"] == made["counts"]["keypoints"] == FRAMES and made["counts"]["matches"] == FRAMES - 1


def test_given_keypoints_get_patches_and_given_matches_are_filtered(monkeypatch: pytest.MonkeyPatch) -> None:
    given = tuple(make_keypoints(np.full(1, 100.0 + n), np.zeros(1)) for n in range(FRAMES))
    external: Any = SimpleNamespace(keypoints=given, longest_gap=EXTERNAL_GAP)
    made = run(monkeypatch, external)
    assert [call[1] for call in made["cut"]] == list(given) and not made["detected"] and not made["matched"]
    assert [call[0] for call in made["filtered"]] == [external] * FRAMES
    assert [call[-1] for call in made["filtered"]] == ["prediction"] * FRAMES
    assert all(match.filters == ("given", "aligned") for match in made["found"][1])


@pytest.mark.parametrize(("external", "gap"), [(False, MAX_GAP), (True, EXTERNAL_GAP)])
def test_patches_live_as_long_as_a_later_frame_needs_them(
    external: bool, gap: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A frame is matched with those up to the longest gap before it: these have patches, earlier ones none."""
    given: Any = SimpleNamespace(keypoints=[None] * FRAMES, longest_gap=gap) if external else None
    made = run(monkeypatch, given)
    assert made["with_patches"] == [list(range(max(index - gap, 0), index + 1)) for index in range(FRAMES)]


def test_the_recorder_is_shown_each_frame_and_the_pair_with_the_frame_before(monkeypatch: pytest.MonkeyPatch) -> None:
    made = run(monkeypatch, None)
    assert [(frame.index, mask.all(), keypoints.range_m[0]) for frame, mask, keypoints in made["frames"]] == [
        (index, index % 2 == 0, 1.0 + index) for index in range(FRAMES)
    ]
    assert [(a.range_m[0], b.range_m[0], match.filters[-1]) for a, b, match in made["pairs"]] == [
        (float(index), 1.0 + index, "aligned") for index in range(1, FRAMES)
    ]
