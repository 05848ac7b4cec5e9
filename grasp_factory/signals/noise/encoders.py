"""A noise model for joint and gripper encoders: position noise, counts, and velocities from both.

Torques and the gripper's force come from other sensors and stay unchanged. So does the TCP's pose:
it is the true pose of the hand, not the pose that follows from the encoders.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from grasp_factory.core.geometry import Array
from grasp_factory.errors import UsageError
from grasp_factory.signals.noise.number_checks import check_figures, digitise


@dataclass(frozen=True, slots=True, kw_only=True)
class EncoderNoise:
    """The imperfections of the robot's own position sensors."""

    joint_noise: float
    """Rad, standard deviation of one reading."""
    joint_resolution: float
    """Rad per count; 0 for no quantisation."""
    velocity_window: float
    """Seconds between the two readings whose difference is the velocity."""
    gripper_noise: float
    """Metres, standard deviation of one reading of the width."""
    gripper_resolution: float
    """Metres per count."""

    def __post_init__(self) -> None:
        """Check the figures.

        Raises:
            UsageError: naming the figure.
        """
        check_figures(self)
        if not self.velocity_window > 0.0:
            window = self.velocity_window
            raise UsageError(f"EncoderNoise: velocity_window {window}: valid: above 0")

    @property
    def joint_sigma(self) -> float:
        """Standard deviation of a joint's reading, rad, quantisation included."""
        return math.hypot(self.joint_noise, self.joint_resolution / math.sqrt(12.0))


class EncoderReading(NamedTuple):
    """The readings of noisy encoders."""

    joint_positions: Array
    """(T, J) rad."""
    joint_velocities: Array
    """(T, J) rad/s."""
    gripper_width: Array
    """(T,) m."""


LIGHTWEIGHT = EncoderNoise(
    # DLR's page on its light-weight robot, the iiwa's ancestor: joint angles are measured on the
    # output side to 0.01 degree. KUKA publishes no figure for the iiwa.
    joint_resolution=math.radians(0.01),
    # Assumptions: half a count of noise; velocities over 20 ms; a gripper that counts in 10 um,
    # with one count of noise.
    joint_noise=math.radians(0.005),
    velocity_window=0.020,
    gripper_resolution=1e-5,
    gripper_noise=1e-5,
)
"""Like a light-weight arm with encoders on the joints' output side."""


def corrupt(
    noise: EncoderNoise,
    joint_positions: ArrayLike,
    joint_velocities: ArrayLike,
    gripper_width: ArrayLike,
    seed: int | np.random.SeedSequence,
) -> EncoderReading:
    """Return the readings that noisy encoders would have.

    Positions get white noise and are rounded to counts. A velocity is the difference of two
    readings, ``velocity_window`` apart, divided by that time. The earlier reading was not recorded:
    its true position follows from the true velocity, and its error is drawn. The sigma of a
    velocity is ``sqrt(2) joint_sigma / window``.

    Args:
        noise: The encoders, e.g. ``LIGHTWEIGHT``.
        joint_positions: (T, J) rad, without noise.
        joint_velocities: (T, J) rad/s, without noise.
        gripper_width: (T,) m, without noise.
        seed: The same seed yields the same noise.
    """
    rng = np.random.default_rng(seed)
    true, speed = (np.asarray(x, np.float64) for x in (joint_positions, joint_velocities))
    width = np.asarray(gripper_width, np.float64)

    def read(angle: Array) -> Array:
        hiss = noise.joint_noise * rng.standard_normal(angle.shape)
        return digitise(angle + hiss, noise.joint_resolution)

    shown = read(true)
    earlier = true - speed * noise.velocity_window
    velocity = (shown - read(earlier)) / noise.velocity_window
    opening = width + noise.gripper_noise * rng.standard_normal(width.shape)
    return EncoderReading(shown, velocity, digitise(opening, noise.gripper_resolution))
