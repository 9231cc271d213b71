"""Backscatter: grain of the reflectivity, fixed to the world."""

from dataclasses import replace

import numpy as np
import pytest

from asfm.simulation.acoustics.backscatter import GRAIN_M
from asfm.simulation.acoustics.renderer import make_renderer
from asfm.simulation.scenes.scene import Scene
from asfm.simulation.scenes.shapes import make_sheet, move_mesh
from tests.simulation.acoustics.quiet_sonar import QUIET_SONAR

EYE = np.eye(4)


def test_grain_is_fixed_to_the_world_as_the_sonar_moves() -> None:
    """After a step ahead the texture of a grainy plate is nearer by that step."""
    plate = Scene("plate", *move_mesh(make_sheet((6.0, 6.0), 0.5), (3.5, 0.0, -0.5)), np.ones(288))
    fine = QUIET_SONAR.model_copy(update={"range_bins": 1200, "azimuth": 20.0, "elevation_bins": 1500})
    smooth, rough = (make_renderer(scene, fine, EYE[None]) for scene in (plate, replace(plate, grain=0.8)))
    step = EYE.copy()
    step[0, 3] = 10 * GRAIN_M
    before, after = (
        rough.render_truth(rough.cast(pose)).clean / np.maximum(smooth.render_truth(smooth.cast(pose)).clean, 1e-3)
        for pose in (EYE, step)
    )
    shift = round(10 * GRAIN_M / rough.model.range_step_m)
    first, last = 480, 560  # about 3.5 m, where range changes nearly as the position along the axis

    def correlation(rows: int) -> float:
        return float(
            np.corrcoef(before[first:last, 40:56].ravel(), after[first - rows : last - rows, 40:56].ravel())[0, 1]
        )

    assert max(correlation(rows) for rows in range(shift - 2, shift + 3)) > 0.5
    assert correlation(0) < 0.2


def test_grain_keeps_the_mean_echo() -> None:
    plate = Scene("plate", *move_mesh(make_sheet((6.0, 6.0), 0.5), (3.5, 0.0, -0.5)), np.ones(288))
    smooth, rough = (make_renderer(scene, QUIET_SONAR, EYE[None]) for scene in (plate, replace(plate, grain=0.5)))
    power = [renderer.compute_power(renderer.trace(renderer.cast(EYE))).sum() for renderer in (smooth, rough)]
    assert power[1] == pytest.approx(power[0], rel=0.02)
