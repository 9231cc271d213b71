"""Random sequences with all sensors, and their comparison."""

import dataclasses

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from asfm.geometry.poses import make_pose
from asfm.geometry.sonar import SonarModel
from asfm.sequence import Sequence
from asfm.types import Frame, HandTracks, Navigation, SensorNoise, Trajectory

EVEN = SonarModel.evenly_spaced("even", (0.5, 3.0), (-0.5, 0.4), (12, 8), 0.2)
UNEVEN = SonarModel("uneven", EVEN.range_m, np.array([-0.5, -0.3, -0.2, -0.05, 0.0, 0.1, 0.3, 0.45]), 0.2)


def make_sequence(sonar: SonarModel = EVEN, count: int = 3, bits: int = 8, seed: int = 0) -> Sequence:
    """Make a sequence of random images with every sensor; pixels are multiples of 1 / (2 ** bits - 1)."""
    rng = np.random.default_rng(seed)
    largest = 2**bits - 1
    images = (rng.integers(0, largest + 1, (count, *sonar.shape)) / np.float32(largest)).astype(np.float32)
    invalid = rng.random((count, *sonar.shape)) < 0.1
    invalid[0] = False
    stamps = np.cumsum(rng.uniform(0.1, 0.2, count)) + 1.7e9
    poses = make_pose(rng.normal(size=(count, 3)), Rotation.random(count, rng=rng))
    return Sequence(
        name="sequence",
        sonar=sonar,
        timestamps_s=stamps,
        read_frame=lambda index: Frame(index, float(stamps[index]), images[index], invalid[index]),
        vehicle_from_sonar=make_pose(np.array([0.1, -0.2, 0.3]), Rotation.from_euler("y", 0.3)),
        odometry=Trajectory(stamps, poses),
        navigation=Navigation(stamps, *(rng.normal(size=(3, count)) * [[1.0], [0.3], [0.3]])),
        groundtruth=Trajectory(stamps - 0.01, poses),
        noise=SensorNoise(0.01, 0.02, 0.03, 0.04, 0.05),
        hand_tracks=HandTracks(stamps, np.arange(count), rng.uniform(1, 2, count), rng.uniform(-0.1, 0.1, count)),
    )


def assert_same(found: Sequence, expected: Sequence) -> None:
    """Check that all fields of two sequences agree: numbers in text exactly, poses and bearings up to rounding."""
    assert found.sonar.name == expected.sonar.name
    np.testing.assert_allclose(found.sonar.range_m, expected.sonar.range_m, atol=1e-9)
    np.testing.assert_allclose(found.sonar.bearing_rad, expected.sonar.bearing_rad, atol=1e-11)
    assert found.sonar.elevation_aperture_rad == pytest.approx(expected.sonar.elevation_aperture_rad)
    np.testing.assert_array_equal(found.timestamps_s, expected.timestamps_s)
    np.testing.assert_allclose(found.vehicle_from_sonar, expected.vehicle_from_sonar, atol=1e-12)
    for name in ("odometry", "groundtruth"):
        ours, theirs = getattr(found, name), getattr(expected, name)
        assert (ours is None) == (theirs is None)
        if ours is not None:
            np.testing.assert_array_equal(ours.timestamps_s, theirs.timestamps_s)
            np.testing.assert_allclose(ours.world_from_vehicle, theirs.world_from_vehicle, atol=1e-12)
    for name in ("navigation", "hand_tracks"):
        ours, theirs = getattr(found, name), getattr(expected, name)
        assert (ours is None) == (theirs is None)
        for field in dataclasses.fields(ours) if ours is not None else ():
            np.testing.assert_array_equal(getattr(ours, field.name), getattr(theirs, field.name))
    for field in dataclasses.fields(SensorNoise):
        assert getattr(found.noise, field.name) == pytest.approx(getattr(expected.noise, field.name), rel=1e-12)
    for ours, theirs in zip(found, expected, strict=True):
        assert (ours.index, ours.timestamp_s) == (theirs.index, theirs.timestamp_s)
        assert ours.image.dtype == np.float32
        np.testing.assert_array_equal(ours.image, theirs.image)
        np.testing.assert_array_equal(ours.invalid, theirs.invalid)
