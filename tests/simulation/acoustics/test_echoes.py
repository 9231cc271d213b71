"""Echoes: second bounces and range delays in the image, and sectors of beams."""

import numpy as np
import pytest

from asfm.simulation.acoustics.echoes import delay_echoes
from asfm.simulation.acoustics.renderer import Renderer, make_renderer
from asfm.simulation.scenes.scene import Scene, join_scenes
from asfm.simulation.scenes.shapes import make_ball, make_sheet, move_mesh
from asfm.types import ImageArray
from tests.simulation.acoustics.quiet_sonar import QUIET_SONAR

EYE = np.eye(4)


def _mirror_and_ball() -> Scene:
    """A wall at 45 degrees across the axis at 3 m, and a ball 2 m to port of where the axis meets it, out of view."""
    wall = move_mesh(make_sheet((4.0, 4.0), 0.5), (3.0, 0.0, 0.0), (3 * np.pi / 4, np.pi / 2, 0.0))
    ball = move_mesh(make_ball(0.3), (3.0, 3.0, 0.0))
    parts = [Scene("", *mesh, np.full(len(mesh[1]), level)) for mesh, level in ((wall, 1e-6), (ball, 1.0))]
    return join_scenes("mirror", parts)


def _render(renderer: Renderer) -> ImageArray:
    return renderer.render(renderer.cast(EYE), np.random.default_rng(0))


def test_second_bounce_makes_a_ghost_behind_the_mirror() -> None:
    """The mirror image of the ball is on the axis at 3 m + 3 m; its near side is the first ghost echo."""
    scene = _mirror_and_ball()
    with_ghost = make_renderer(scene, QUIET_SONAR.model_copy(update={"multi_path": True}), EYE[None])
    image = _render(with_ghost)
    row, column = np.unravel_index(image.argmax(), image.shape)
    assert with_ghost.model.range_m[row] == pytest.approx(6.0 - 0.3, abs=2 * with_ghost.model.range_step_m)
    assert abs(with_ghost.model.bearing_rad[column]) < 3 * with_ghost.model.bearing_step_rad
    without = _render(make_renderer(scene, QUIET_SONAR, EYE[None]))
    assert without[row - 5 : row + 20].max() < 0.05 * image.max()
    # The ground truth has no ghosts.
    assert with_ghost.render_truth(with_ghost.cast(EYE)).clean[row - 5 : row + 20].max() < 0.05 * image.max()


def test_ghosts_lose_the_power_of_the_reflections() -> None:
    scene = _mirror_and_ball()
    loud, soft = (
        _render(
            make_renderer(scene, QUIET_SONAR.model_copy(update={"multi_path": True, "multi_path_db": level}), EYE[None])
        )
        for level in (-40.0, -60.0)
    )
    assert soft.max() == pytest.approx(loud.max() / 10, rel=0.1)  # 20 dB of power are a tenth of the amplitude


def test_range_delays_are_exponential_and_not_in_the_truth() -> None:
    ball = Scene("ball", *move_mesh(make_ball(0.3), (4.0, 0.0, 0.0)), np.ones(5120))
    renderer = make_renderer(ball, QUIET_SONAR.model_copy(update={"range_sigma": 0.2}), EYE[None])
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


def test_sectors_join_to_the_image_of_all_beams() -> None:
    """The image is traced by sectors, the truth at once; without noise and side lobes both are equal."""
    renderer = make_renderer(_mirror_and_ball(), QUIET_SONAR, EYE[None])
    assert [sector.beams.stop - sector.beams.start for sector in renderer.sectors] == [93, 3]
    assert np.abs(_render(renderer) - renderer.render_truth(renderer.cast(EYE)).clean).max() < 1e-4
