"""Summary: covariances that include the mirror image, and the diagnostics of every check."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from asfm.backend.diagnostics.observability import SPAN
from asfm.config import Config
from asfm.pipeline.summary import summarise
from asfm.stages import StageClock
from tests.pipeline.stubs import stub_stages
from tests.worlds import make_landmarks, make_vehicle_sequence


@pytest.mark.parametrize("scene", ["unknown", "below"])
def test_covariances_state_the_mirror_image_and_every_check_is_heard(
    scene: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The mirror image inflates what is stated, while the warnings judge the image that is shown alone."""
    stub = stub_stages(monkeypatch, "summary")
    sequence, landmarks, ratio = make_vehicle_sequence(), make_landmarks(5, 2), np.full(3, 1.7)
    bundle = SimpleNamespace(world_from_vehicle=np.zeros((len(sequence), 4, 4)))
    solution: Any = SimpleNamespace(bundle=bundle, tracks="tracks", observed="used", elevation_information_ratio=ratio)
    within = SimpleNamespace(pose="within one image", point_m2="within one image")
    informed = stub("marginalise_points", "information")
    measured = stub("measure_uncertainty", within)
    compared = stub("measure_consistency", "consistency")
    examined = stub("diagnose_conventions", ("convention",))
    contradicted = stub("warn_of_inconsistency", ("inconsistent",))
    withdrawn = stub("withdraw_well_constrained", lambda given, *_: replace(given, well_constrained=given.views > 99))
    mirrors = stub("find_mirror", "mirror")
    inflated = stub("inflate_for_mirror", SimpleNamespace(pose="over both images", point_m2="of both images"))
    described = stub("describe_landmarks", landmarks)
    stub("warn_of_disconnected_steps", ("disconnected",))
    mirror_warnings = stub("warn_of_mirror", ("mirror ambiguity",))
    unreliable = stub("warn_of_unreliable_poses", ("unobserved", "uncertain"))
    clock, config = StageClock(), Config.model_validate({"backend": {"scene": scene}})
    before: Any = ("found before",)
    found: Any = summarise(sequence, solution, config, clock, before)
    assert informed == [(bundle,)] and measured == [(bundle, ratio, SPAN, "information")]
    assert compared == [(solution, sequence.timestamps_s, "information", config.backend.max_views)]
    assert withdrawn == [(landmarks, "consistency", True)] and found.consistency == "consistency"
    assert contradicted == [("consistency",)] and examined == [(solution, sequence.timestamps_s)]
    assert mirrors == [(solution, scene)]
    assert inflated == [(within, solution, "mirror")]
    assert described[0][1] == "of both images" and found.pose_covariance == "over both images"
    assert mirror_warnings == [(within, bundle, "mirror")] and unreliable == [(solution, within)]
    assert found.diagnostics == (
        "found before",
        "disconnected",
        "mirror ambiguity",
        "unobserved",
        "uncertain",
        "inconsistent",
        "convention",
    )
    assert (
        not found.landmarks.well_constrained.any() and found.trajectory.world_from_vehicle is bundle.world_from_vehicle
    )
    assert found.tracks == "tracks" and found.observed == "used"
    assert clock.reports[-1].counts == {"landmarks": 5, "well constrained": 0}
