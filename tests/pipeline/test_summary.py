"""Summary: covariances that include the mirror image, and the diagnostics of every check."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from asfm.backend.diagnostics.observability import SPAN
from asfm.config import Config
from asfm.consistency import Consistency, LocalFit
from asfm.pipeline.summary import summarise
from asfm.stages import StageClock
from tests.pipeline.stubs import stub_stages
from tests.worlds import make_landmarks, make_vehicle_sequence


@pytest.mark.parametrize(("scene", "measured"), [("unknown", False), ("below", False), ("below", True)])
def test_covariances_state_the_mirror_image_and_every_check_is_heard(
    scene: str, measured: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The mirror image inflates what is stated, while the warnings judge the image that is shown alone.

    The local fit is measured where no odometry contradicts a wrong solution.
    """
    stub = stub_stages(monkeypatch, "summary")
    sequence, landmarks, ratio = make_vehicle_sequence(), make_landmarks(5, 2), np.full(3, 1.7)
    bundle = SimpleNamespace(world_from_vehicle=np.zeros((len(sequence), 4, 4)))
    problem = SimpleNamespace(sensors=SimpleNamespace(measured=measured))
    solution: Any = SimpleNamespace(
        problem=problem, bundle=bundle, tracks="tracks", observed="used", elevation_information_ratio=ratio
    )
    within = SimpleNamespace(pose="within one image", point_m2="within one image")
    informed = stub("marginalise_points", "information")
    uncertain = stub("measure_uncertainty", within)
    compared = stub("measure_consistency", Consistency(used_share=0.7))
    fitted = stub("measure_local_fit", LocalFit(1.5, poor=True))
    poor = stub("warn_of_poor_fit", lambda fit: ("poor",) if fit else ())
    examined = stub("diagnose_conventions", () if not measured else ("convention",))
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
    assert informed == [(bundle,)] and uncertain == [(bundle, ratio, SPAN, "information")]
    assert compared == [(solution, sequence.timestamps_s, "information", config.backend.max_views)]
    expected = Consistency(used_share=0.7, local_fit=None if measured else LocalFit(1.5, poor=True))
    assert fitted == ([] if measured else [(solution,)]) and poor == [(expected.local_fit,)]
    assert withdrawn == [(landmarks, expected, True)] and found.consistency == expected
    assert contradicted == [(expected,)] and examined == [(solution, sequence.timestamps_s)]
    assert mirrors == [(solution, scene)]
    assert inflated == [(within, solution, "mirror")]
    assert described[0][1] == "of both images" and found.pose_covariance == "over both images"
    assert mirror_warnings == [(within, bundle, "mirror")] and unreliable == [(solution, within)]
    assert found.diagnostics == (
        "found before",
        "disconnected",
        *(() if measured else ("poor",)),
        "mirror ambiguity",
        "unobserved",
        "uncertain",
        "inconsistent",
        *(("convention",) if measured else ()),
    )
    assert (
        not found.landmarks.well_constrained.any() and found.trajectory.world_from_vehicle is bundle.world_from_vehicle
    )
    assert found.tracks == "tracks" and found.observed == "used"
    assert clock.reports[-1].counts == {"landmarks": 5, "well constrained": 0}
