"""Denoising table: comparison with the truth, averages over frames and groups, and losses against the baselines."""

from dataclasses import replace

import numpy as np
import pytest

from asfm.config import Config
from asfm.errors import AsfmError
from asfm.evaluation.denoising.methods import DENOISERS, OURS, RAW, WAVELET
from asfm.evaluation.denoising.metrics import DenoisingQuality, measure_psnr
from asfm.evaluation.denoising.table import DenoisedFrame, DenoisingTable, compare_denoisers, list_losses
from asfm.types import Frame, FrameTruth
from tests.evaluation.denoising.noisy_steps import SHAPE, draw_steps, frame_of


def test_each_method_is_compared_with_the_truth() -> None:
    noisy, clean = draw_steps()
    truth = FrameTruth(np.where(clean > 0.5, 0.0, np.nan), clean)
    found = compare_denoisers(frame_of(noisy), truth, Config())
    assert list(found.qualities) == list(DENOISERS)
    assert found.qualities[RAW].psnr_db == pytest.approx(measure_psnr(noisy, clean))
    inside = found.qualities[RAW].support_psnr_db
    assert inside == pytest.approx(measure_psnr(noisy[clean > 0.5], clean[clean > 0.5]))


def test_invalid_pixels_do_not_change_the_quality() -> None:
    noisy, clean = draw_steps()
    truth, invalid = FrameTruth(np.zeros(SHAPE), clean), np.zeros(SHAPE, dtype=bool)
    invalid[:, 40:60] = True
    plain = {RAW: DENOISERS[RAW]}
    found = [
        compare_denoisers(Frame(0, 0.0, np.where(invalid, np.float32(fill), noisy), invalid), truth, Config(), plain)
        for fill in (0, 1)
    ]
    assert found[0].qualities == found[1].qualities


@pytest.mark.parametrize(("shape", "clean"), [((10, 30), (10, 30)), ((30, 30), (30, 31))])
def test_different_shapes_and_small_images_are_an_error(shape: tuple[int, int], clean: tuple[int, int]) -> None:
    truth = FrameTruth(np.zeros(clean), np.zeros(clean, dtype=np.float32))
    with pytest.raises(AsfmError, match=r"at least 11 x 11 .* found \(\d+, 30\)"):
        compare_denoisers(frame_of(np.zeros(shape, dtype=np.float32)), truth, Config())


def row(scene: str, sonar: str, method: str, psnr_db: float, ssim: float, support_db: float | None) -> DenoisedFrame:
    return DenoisedFrame(scene, sonar, 0, method, DenoisingQuality(psnr_db, ssim, support_db), 5.0)


ROWS = (
    row("pier", "a", RAW, 20.0, 0.3, 18.0),
    row("pier", "a", WAVELET, 22.0, 0.4, None),
    row("pier", "a", OURS, 25.0, 0.9, 17.0),
    row("tank", "b", RAW, 30.0, 0.3, 18.0),
    row("tank", "b", WAVELET, 24.0, 0.4, None),
    row("tank", "b", OURS, 27.0, 0.9, 23.0),
)


def test_averages_over_all_frames_and_over_groups() -> None:
    table = DenoisingTable(ROWS)
    assert table.methods == (RAW, WAVELET, OURS) and table.names("scene") == ("pier", "tank")
    assert table.average(OURS).psnr_db == pytest.approx(26.0)
    assert table.average(OURS, scene="tank").psnr_db == pytest.approx(27.0)
    assert table.average(WAVELET).support_psnr_db is None
    assert table.as_dict()["by_sonar"]["b"][OURS]["ssim"] == pytest.approx(0.9)


def test_losses_are_described_only_where_a_baseline_is_better() -> None:
    psnr, support = list_losses(DenoisingTable(ROWS))
    assert (
        psnr == "ours loses in PSNR: tank (27.00 against 30.00 of raw); b (27.00 against 30.00 of raw); 1 of 2 frames"
    )
    assert support.startswith("ours loses in PSNR in the support: pier (17.00 against 18.00 of raw)")
    better = tuple(
        replace(row, quality=DenoisingQuality(40.0, 0.95, 40.0)) if row.method == OURS else row for row in ROWS
    )
    assert list_losses(DenoisingTable(better)) == ("ours loses by no measure, in no scene and for no sonar",)
    worse = tuple(replace(row, quality=DenoisingQuality(1.0, 0.1, 1.0)) if row.method == OURS else row for row in ROWS)
    assert list_losses(DenoisingTable(worse))[0] == (
        "ours loses in PSNR: 1.00 against 25.00 dB of raw; every scene; every sonar; 2 of 2 frames"
    )
