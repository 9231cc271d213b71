"""Navigation at the frame times: odometry, depth and attitude, interpolated, filtered and in one world frame."""

from dataclasses import dataclass, replace

from asfm.config import BackendConfig
from asfm.diagnostics import Diagnostic
from asfm.navigation.depth_attitude import DepthAttitude, interpolate_depth_attitude
from asfm.navigation.odometry import Odometry, read_odometry
from asfm.navigation.sensor_consistency import align_initial_attitude, compare_odometry_attitude
from asfm.sequence import Sequence
from asfm.types import Trajectory


@dataclass(frozen=True)
class FrameNavigation:
    """What the vehicle's sensors other than the sonar measured, at the frame times."""

    odometry: Odometry | None
    """None where there is none or it is not used. In the world frame of depth and attitude, if there are any."""
    depth_attitude: DepthAttitude
    """Without readings where there are none or they are not used."""

    @property
    def diagnostics(self) -> tuple[Diagnostic, ...]:
        """What is wrong with the readings."""
        of_odometry = () if self.odometry is None else self.odometry.diagnostics
        return (*of_odometry, *self.depth_attitude.diagnostics)


def read_navigation(sequence: Sequence, config: BackendConfig) -> FrameNavigation:
    """Interpolate odometry, depth and attitude at the frame times, and reject outliers.

    Odometry whose initial depth, roll or pitch differs from the readings of the other sensors is moved to these,
    except in the channels in which the two contradict each other later on as well.

    Args:
        sequence: frame times, readings and their stated noise.
        config: which sensors are used.
    """
    odometry = read_odometry(sequence, config)
    if odometry is None:
        return FrameNavigation(None, interpolate_depth_attitude(sequence, config))
    poses, noise = odometry.world_from_vehicle, sequence.noise
    depth_attitude = interpolate_depth_attitude(sequence, config, Trajectory(sequence.timestamps_s, poses))
    trusted = ~compare_odometry_attitude(poses, depth_attitude, noise).contradicts
    poses, moved = align_initial_attitude(poses, depth_attitude, noise, trusted)
    odometry = replace(odometry, world_from_vehicle=poses, diagnostics=(*odometry.diagnostics, *moved))
    return FrameNavigation(odometry, depth_attitude)
