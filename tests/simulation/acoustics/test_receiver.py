"""Point spread of the receiver: pulse, main lobe, side lobes and cross-talk."""

import numpy as np
import pytest

from asfm.simulation.acoustics.receiver import leak_beams, make_point_spread, spread_beams, spread_ranges, sum_beams
from asfm.simulation.sonars.parameters import ImagingSonar, make_sonar_model
from asfm.simulation.sonars.presets import PRESETS
from asfm.types import ImageArray

SONAR = ImagingSonar(range_bins=300, azimuth_bins=128, azimuth=60)
MODEL = make_sonar_model(SONAR)


def _point() -> ImageArray:
    """One beam's echo in one row: (beams, ranges)."""
    power = np.zeros(MODEL.shape[::-1], dtype=np.float32)
    power[64, 150] = 1.0
    return power


def test_point_spread_preserves_power_and_has_the_requested_widths() -> None:
    sonar = SONAR.model_copy(update={"beam_width_deg": 1.0, "pulse_length_m": 0.1})
    spread = make_point_spread(sonar, MODEL)
    received = spread_beams(spread_ranges(_point(), spread), spread)
    assert received.sum() == pytest.approx(1.0, rel=1e-3)
    assert received.argmax() == 64 * 300 + 150
    width_beams = 1.0 / np.rad2deg(MODEL.bearing_step_rad)
    assert (received[:, 150] >= 0.5 * received.max()).sum() == pytest.approx(width_beams, abs=1.5)
    assert (received[64] >= 0.5 * received.max()).sum() == pytest.approx(0.1 / MODEL.range_step_m, abs=1.5)


@pytest.mark.parametrize("level_db", [-26.0, -40.0])
def test_side_lobes_form_a_ring_at_the_range_of_a_strong_echo(level_db: float) -> None:
    sonar = SONAR.model_copy(update={"side_lobe_db": level_db, "cross_talk_db": -60.0})
    spread = make_point_spread(sonar, MODEL)
    pulsed = spread_ranges(_point(), spread)
    leaked = leak_beams(sum_beams(pulsed, spread), spread)
    peak, ring_db = spread_beams(pulsed, spread)[64, 150], 10 * np.log10(leaked[:, 150])
    ring_db -= 10 * np.log10(peak)
    assert ring_db[66] == pytest.approx(level_db, abs=1.5)
    assert ring_db[64 + 16] - ring_db[64 + 32] == pytest.approx(6, abs=2)
    assert ring_db.min() > level_db - 40
    assert leaked[:, 100].max() == 0


def test_selected_beams_equal_those_of_the_whole_image() -> None:
    """Lobes and side lobes reach across the borders of a selection of beams of any width."""
    sonar = SONAR.model_copy(update={"beam_width_deg": 2.0})
    spread = make_point_spread(sonar, MODEL)
    power = np.random.default_rng(0).random((128, 300), dtype=np.float32)
    total = sum_beams(power, spread)
    lobes, leaks = spread_beams(power, spread), leak_beams(total, spread)
    for selected in (slice(0, 1), slice(3, 50), slice(120, 128)):
        assert np.allclose(spread_beams(power, spread, selected), lobes[selected], rtol=1e-5)
        assert np.array_equal(leak_beams(total, spread, selected), leaks[selected])


@pytest.mark.parametrize("preset", PRESETS)
def test_main_lobe_of_every_sonar_preserves_power_away_from_the_edges(preset: str) -> None:
    model = make_sonar_model(PRESETS[preset])
    spread = make_point_spread(PRESETS[preset], model)
    reach, beams = len(spread.lobe) // 2, len(model.bearing_rad)
    assert reach < beams // 4
    np.testing.assert_allclose(spread.lobe_matrix.sum(axis=0), 1, atol=1e-5)
    assert spread.lobe_matrix.argmax(axis=0).tolist() == list(range(beams))


def test_main_lobe_is_gaussian_in_the_sine_of_the_bearing() -> None:
    """Half power at half the width on the axis; at 60 degrees a line array's lobe is twice as wide in angle."""
    sonar = ImagingSonar(range_bins=50, azimuth_bins=601, azimuth=150, beam_width_deg=2.0)
    model = make_sonar_model(sonar)
    lobes = make_point_spread(sonar, model).lobe_matrix
    widths_deg = []
    for bearing_deg in (0.0, 60.0):
        column = int(model.column_at_bearing(np.array(np.deg2rad(bearing_deg))))
        widths_deg.append((lobes[:, column] >= 0.5 * lobes[column, column]).sum() * np.rad2deg(model.bearing_step_rad))
    assert widths_deg == pytest.approx([2.0, 4.0], abs=0.3)


def test_cross_talk_spreads_a_share_of_the_mean_over_all_beams() -> None:
    sonar = SONAR.model_copy(update={"side_lobe_db": -300.0, "cross_talk_db": -20.0})
    spread = make_point_spread(sonar, MODEL)
    leaked = leak_beams(sum_beams(_point(), spread), spread)
    np.testing.assert_allclose(leaked[:, 150], 0.01 / 128, rtol=1e-4)
    assert leaked[:, :150].max() == leaked[:, 151:].max() == 0


def test_side_lobes_are_sums_over_boxes_of_beams() -> None:
    """The cumulative sums give the same as adding the beams of every box one by one."""
    spread = make_point_spread(SONAR, MODEL)
    power = np.random.default_rng(1).random((128, 300), dtype=np.float32)
    expected = np.full((128, 300), spread.cross_talk * power.mean(axis=0), dtype=float)
    for half, level in spread.side_lobes:
        for beam in range(128):
            expected[beam] += level * power[max(beam - half, 0) : beam + half + 1].sum(axis=0, dtype=float)
    np.testing.assert_allclose(leak_beams(sum_beams(power, spread), spread), expected, rtol=1e-3)
