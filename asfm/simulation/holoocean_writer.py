"""Writer of simulated sequences in the layout of HoloOcean and NeuSIS: Config.json and one pickle per ping."""

import json
import pickle
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from asfm.atomic_folder import FolderKind, atomic_folder
from asfm.errors import AsfmError
from asfm.simulation.simulate import SimulatedSequence
from asfm.simulation.sonars.holoocean_scenario import CONTRAST_PER_MULT_SIGMA, SCALED_NOISE_EXPONENT
from asfm.simulation.sonars.parameters import ImagingSonar

PROTOCOL = 4
MOUNT = {"socket": "SonarSocket"}
"""Pose sensor and sonar have the same socket and rotation: the poses are those of the sonar."""

PICKLES = FolderKind(
    name="pickles", marks=("Config.json", "Data/0.pkl"), patterns=("Config.json", "Data", "Data/*[0-9].pkl")
)


def write_pickles(
    folder: Path,
    simulated: SimulatedSequence,
    overwrite: bool = False,
    progress: Callable[[int, int], None] | None = None,
) -> None:
    """Write Config.json and Data/<i>.pkl with the keys ImagingSonar, PoseSensor and t; atomically.

    An image is float32 (RangeBins, AzimuthBins), column 0 starboard; a pose is the true (4, 4) world_from_sonar.

    Args:
        folder: the folder to create.
        simulated: the sequence; its frames are rendered one by one in order.
        overwrite: replace an existing folder of this layout.
        progress: called with (frames written, number of frames) after each frame.

    Raises:
        AsfmError: the folder exists or cannot be written, or the beams are uneven, which the layout cannot express.
    """
    if simulated.sonar.bearings_deg is not None and not _is_even(simulated.sonar.bearings_deg):
        raise AsfmError(
            f"{simulated.sonar.name} has uneven beams, which HoloOcean's layout cannot express: write the native format"
            " or simulate the preset holoocean"
        )
    with atomic_folder(folder, PICKLES, overwrite) as partial:
        text = json.dumps(describe_scenario(simulated.sonar, simulated.scene.name), indent=2)
        (partial / "Config.json").write_text(text + "\n", encoding="utf-8")
        (partial / "Data").mkdir()
        _write_states(partial / "Data", simulated, progress)


def _write_states(folder: Path, simulated: SimulatedSequence, progress: Callable[[int, int], None] | None) -> None:
    """Render the frames and write one pickle per frame."""
    sequence = simulated.sequence
    assert sequence.groundtruth is not None
    poses = sequence.groundtruth.world_from_vehicle @ sequence.vehicle_from_sonar
    for index, frame in enumerate(sequence):
        state = {"ImagingSonar": frame.image, "PoseSensor": poses[index].astype(np.float64), "t": frame.timestamp_s}
        (folder / f"{index}.pkl").write_bytes(pickle.dumps(state, protocol=PROTOCOL))
        if progress is not None:
            progress(index + 1, len(sequence))


def describe_scenario(sonar: ImagingSonar, world: str) -> dict[str, Any]:
    """Return the HoloOcean scenario of a sonar, with the keys of its JSON file.

    :func:`asfm.simulation.sonars.holoocean_scenario.read_mounted_sonar` is the inverse.
    """
    configuration = {
        "RangeBins": sonar.range_bins,
        "AzimuthBins": sonar.azimuth_bins,
        "RangeMin": sonar.range_min,
        "RangeMax": sonar.range_max,
        "Azimuth": sonar.azimuth,
        "Elevation": sonar.elevation,
        "AddSigma": sonar.add_sigma,
        "MultSigma": sonar.mult_sigma / CONTRAST_PER_MULT_SIGMA,
        "ScaleNoise": sonar.noise_range_exponent == SCALED_NOISE_EXPONENT,
        "RangeSigma": sonar.range_sigma,
        "MultiPath": sonar.multi_path,
    }
    rate = {"Hz": sonar.rate_hz}
    sensors = [
        {"sensor_type": "PoseSensor", **MOUNT, **rate},
        {"sensor_type": "ImagingSonar", **MOUNT, **rate, "configuration": configuration},
    ]
    agent = {"agent_name": "auv0", "agent_type": "HoveringAUV", "sensors": sensors, "control_scheme": 0}
    return {"name": "asfm", "world": world, "main_agent": "auv0", "ticks_per_sec": 200, "agents": [agent]}


def _is_even(bearings_deg: tuple[float, ...]) -> bool:
    """Return whether beams are evenly spaced, to 1 %."""
    steps = np.diff(bearings_deg)
    return bool(np.ptp(steps) <= 0.01 * steps.mean())
