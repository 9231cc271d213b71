"""What a real image has besides direct echoes: second bounces, delays, grain."""

from dataclasses import replace

import numpy as np
import pytest

from asfm.simulation.acoustics.backscatter import GRAIN_M
from asfm.simulation.acoustics.echoes import delay_echoes
from asfm.simulation.acoustics.renderer import Renderer, make_renderer
from asfm.simulation.scenes.scene import Scene, join_scenes
from asfm.simulation.scenes.shapes import make_ball, make_sheet, move_mesh
from asfm.simulation.sonars.parameters import ImagingSonar
from asfm.types import ImageArray

SONAR = ImagingSonar(
    range_min=0.5,
    range_max=8.0,
    range_bins=300,
    azimuth=60,
    azimuth_bins=96,
    elevation=20,
    elevation_bins=300,
    add_sigma=0.0,
    mult_sigma=0.0,
    gain=1.0,
    multi_path_db=-6.0,
    side_lobe_db=-90.0,
    cross_talk_db=-90.0,
)
EYE = np.eye(4)


def _mirror_and_ball() -> Scene:
    """A wall at 45 degrees across the axis at 3 m, and a ball 2 m to port of where the axis meets it, out of view."""
    wall = move_mesh(make_sheet((4.0, 4.0), 0.5), (3.0, 0.0, 0.0), (3 * np.pi / 4, np.pi / 2, 0.0))
    ball = move_mesh(make_ball(0.3), (3.0, 3.0, 0.0))
    parts = [Scene("", *mesh, np.full(len(mesh[1]), level)) for mesh, level in ((wall, 1e-6), (ball, 1.0))]
    return join_scenes("mirror", parts)


def _render(renderer: Renderer) -> ImageArray:
    return renderer.render(renderer.cast(EYE), np.random.default_rng(0))


def test_second_bounce_shows_a_ghost_behind_the_mirror() -> None:
    """The mirror puts the ball's image on the axis at 3 m + 3 m: its near side is the first ghost echo."""
    scene = _mirror_and_ball()
    with_ghost = make_renderer(scene, SONAR.model_copy(update={"multi_path": True}), EYE[None])
    image = _render(with_ghost)
    row, column = np.unravel_index(image.argmax(), image.shape)
    assert with_ghost.model.range_m[row] == pytest.approx(6.0 - 0.3, abs=2 * with_ghost.model.range_step_m)
    assert abs(with_ghost.model.bearing_rad[column]) < 3 * with_ghost.model.bearing_step_rad
    without = _render(make_renderer(scene, SONAR, EYE[None]))
    assert without[row - 5 : row + 20].max() < 0.05 * image.max()
    # Truth knows of no ghosts.
    assert with_ghost.render_truth(with_ghost.cast(EYE)).clean[row - 5 : row + 20].max() < 0.05 * image.max()


def test_ghosts_lose_what_the_mirrors_take() -> None:
    scene = _mirror_and_ball()
    loud, soft = (
        _render(make_renderer(scene, SONAR.model_copy(update={"multi_path": True, "multi_path_db": level}), EYE[None]))
        for level in (-40.0, -60.0)
    )
    assert soft.max() == pytest.approx(loud.max() / 10, rel=0.1)  # 20 dB of power are a tenth of the amplitude


def test_range_delays_are_exponential_and_only_in_the_image() -> None:
    ball = Scene("ball", *move_mesh(make_ball(0.3), (4.0, 0.0, 0.0)), np.ones(5120))
    renderer = make_renderer(ball, SONAR.model_copy(update={"range_sigma": 0.2}), EYE[None])
    echoes = renderer.trace(renderer.cast(EYE))
    late = delay_echoes(echoes, 8.0, np.random.default_rng(1)).row - echoes.row
    assert (
        late.min() >= 0 and late.mean() == pytest.approx(8.0, rel=0.03) and late.std() == pytest.approx(8.0, rel=0.05)
    )
    weight = _render(renderer) ** 2
    clean = renderer.render_truth(renderer.cast(EYE)).clean ** 2
    middle_m = [(power.sum(axis=1) @ renderer.model.range_m) / power.sum() for power in (weight, clean)]
    assert middle_m[0] - middle_m[1] == pytest.approx(0.2, abs=0.08)
    assert np.nanmax(np.abs(renderer.render_truth(renderer.cast(EYE)).elevation_rad)) < np.arcsin(0.3 / 4) + 0.004


def test_grain_stays_with_the_world_as_the_sonar_moves() -> None:
    """Seen from further ahead, a grainy plate's texture is nearer by the step, and is not where it was."""
    plate = Scene("plate", *move_mesh(make_sheet((6.0, 6.0), 0.5), (3.5, 0.0, -0.5)), np.ones(288))
    fine = SONAR.model_copy(update={"range_bins": 1200, "azimuth": 20.0, "elevation_bins": 1500})
    smooth, rough = (make_renderer(scene, fine, EYE[None]) for scene in (plate, replace(plate, grain=0.8)))
    step = EYE.copy()
    step[0, 3] = 10 * GRAIN_M
    before, after = (
        rough.render_truth(rough.cast(pose)).clean / np.maximum(smooth.render_truth(smooth.cast(pose)).clean, 1e-3)
        for pose in (EYE, step)
    )
    shift = round(10 * GRAIN_M / rough.model.range_step_m)
    first, last = 480, 560  # about 3.5 m, where range grows nearly as the way ahead does

    def likeness(rows: int) -> float:
        return float(
            np.corrcoef(before[first:last, 40:56].ravel(), after[first - rows : last - rows, 40:56].ravel())[0, 1]
        )

    assert max(likeness(rows) for rows in range(shift - 2, shift + 3)) > 0.5
    assert likeness(0) < 0.2


def test_grain_keeps_the_mean_echo() -> None:
    plate = Scene("plate", *move_mesh(make_sheet((6.0, 6.0), 0.5), (3.5, 0.0, -0.5)), np.ones(288))
    smooth, rough = (make_renderer(scene, SONAR, EYE[None]) for scene in (plate, replace(plate, grain=0.5)))
    power = [renderer.measure_power(renderer.trace(renderer.cast(EYE))).sum() for renderer in (smooth, rough)]
    assert power[1] == pytest.approx(power[0], rel=0.02)


def test_sectors_join_without_a_seam() -> None:
    """The image is traced sector by sector, the truth at once; without noise and side lobes they are the same."""
    renderer = make_renderer(_mirror_and_ball(), SONAR, EYE[None])
    assert [sector.beams.stop - sector.beams.start for sector in renderer.sectors] == [93, 3]
    assert np.abs(_render(renderer) - renderer.render_truth(renderer.cast(EYE)).clean).max() < 1e-4
