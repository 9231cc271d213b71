"""HoloOcean folders: Config.json and pickled ticks."""

import json
import pickle
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from asfm.geometry.poses import make_pose

SHAPE = (16, 6)
GEOMETRY = {"Azimuth": 60, "Elevation": 12, "RangeMin": 0.5, "RangeMax": 4.5, "RangeBins": 16, "AzimuthBins": 6}


def make_config(**changes: Any) -> dict[str, Any]:
    sonar = {"sensor_type": "ImagingSonar", "socket": "S", "Hz": 4, "rotation": [0, 45, 0], "configuration": GEOMETRY}
    pose = {"sensor_type": "PoseSensor", "socket": "S", "rotation": [0, 45, 0]}
    sonar.update(changes.pop("sonar", {}))
    pose.update(changes.pop("pose", {}))
    return {"agents": [{"sensors": [{"sensor_type": "DepthSensor"}, pose, sonar]}], **changes}


def make_state(index: int, **changes: Any) -> dict[str, Any]:
    rng = np.random.default_rng(index)
    pose = make_pose(np.array([index, 2.0, 3.0]), Rotation.from_euler("z", 0.1 * index)).astype(np.float32)
    image = rng.random(SHAPE, dtype=np.float32)
    return {"ImagingSonar": image, "PoseSensor": pose, "t": 10.0 + index, "DepthSensor": np.float32(3), **changes}


def write_folder(root: Path, states: list[dict[str, Any]], config: dict[str, Any] | None = None) -> Path:
    (root / "Data").mkdir(parents=True)
    (root / "Config.json").write_text(json.dumps(make_config() if config is None else config))
    for index, state in enumerate(states):
        (root / "Data" / f"{index}.pkl").write_bytes(pickle.dumps(state))
    return root
