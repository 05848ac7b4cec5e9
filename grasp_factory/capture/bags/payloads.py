"""Messages of ROS as payloads of devices: the reverse of how sessions write them.

Definitions: https://github.com/ros2/common_interfaces. A function raises ValueError for a message
that does not fit.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from grasp_factory.capture.bags.pixel_decoding import DecodedImage
from grasp_factory.capture.samples import (
    InertialReading,
    JointReading,
    TactileReading,
    Vector,
    WrenchReading,
)

GRIPPER = "gripper"
"""Name of the joint whose position is the gripper's width, m, and whose effort is its force, N."""
_MOST_JOINTS = 100


def imu_reading(message: Any) -> InertialReading:
    """Return the reading of a sensor_msgs/Imu."""
    force, rate = message.linear_acceleration, message.angular_velocity
    return InertialReading(specific_force=_xyz(force), angular_velocity=_xyz(rate))


def wrench_reading(message: Any) -> WrenchReading:
    """Return the reading of a geometry_msgs/WrenchStamped."""
    wrench = message.wrench
    return WrenchReading(wrench=np.concatenate([_xyz(wrench.force), _xyz(wrench.torque)]))


def joint_reading(state: Any, command: Any | None, gripper: str) -> JointReading:
    """Return the reading of a sensor_msgs/JointState and the latest command.

    Args:
        state: measured positions, velocities and efforts; what is left out of it is NaN.
        command: commanded positions, joints by name; None without one.
        gripper: the joint whose position is the gripper's width, m, and whose effort its force, N.

    Raises:
        ValueError: if the lengths of its arrays do not fit its names.
    """
    names = list(state.name)
    if len(names) > _MOST_JOINTS or len(set(names)) < len(names):
        raise ValueError(f"{len(names)} joints, valid: up to {_MOST_JOINTS}, each once")
    columns = [_column(values, len(names)) for values in (state.position, state.velocity)]
    effort = _column(state.effort, len(names))
    targets = _targets(names, command)
    arm = np.array([name != gripper for name in names], bool)
    width, width_target, force = (
        float(values[~arm][0]) if not arm.all() else float("nan")
        for values in (columns[0], targets, effort)
    )
    return JointReading(
        positions=columns[0][arm],
        velocities=columns[1][arm],
        torques=effort[arm],
        position_targets=targets[arm],
        gripper_width=width,
        gripper_width_target=width_target,
        gripper_force=force,
    )


def taxel_reading(message: Any) -> TactileReading:
    """Return the reading of a sensor_msgs/Image of 32FC1."""
    if message.encoding != "32FC1":
        raise ValueError("taxels are images of 32FC1")
    height, width, step = int(message.height), int(message.width), int(message.step)
    data = np.asarray(message.data, np.uint8)
    if not (0 < height and 0 < 4 * width <= step and data.size >= height * step):
        raise ValueError(f"{width} x {height} taxels in {data.size} bytes")
    rows = np.ascontiguousarray(data[: height * step].reshape(height, step)[:, : 4 * width])
    values = rows.view(">f4" if message.is_bigendian else "<f4")
    return TactileReading(pressure=values.astype(np.float64))


def colour_pixels(image: DecodedImage) -> NDArray[np.uint8]:
    """Return the pixels (H, W, 3) of a colour or grey image."""
    if image.is_depth or image.values.dtype != np.uint8:
        raise ValueError("a depth image, or one of 16 bits, where a colour image should be")
    values = image.values if image.values.ndim == 3 else np.dstack([image.values] * 3)
    return np.ascontiguousarray(values)


def depth_pixels(image: DecodedImage) -> NDArray[np.uint16]:
    """Return the depth (H, W), mm, of a depth image."""
    if not image.is_depth:
        raise ValueError("a colour image where a depth image should be")
    return np.ascontiguousarray(image.values)


def _xyz(vector: Any) -> Vector:
    return np.array([vector.x, vector.y, vector.z], np.float64)


def _column(values: Any, length: int) -> Vector:
    """Return an array of a JointState; one that is left out is NaN."""
    if len(values) not in (0, length):
        raise ValueError(f"{len(values)} values for {length} joints")
    return np.array(values, np.float64) if len(values) else np.full(length, np.nan)


def _targets(names: list[str], command: Any | None) -> Vector:
    if command is None:
        return np.full(len(names), np.nan)
    positions = _column(command.position, len(command.name))
    by_name = dict(zip(command.name, positions.tolist(), strict=True))
    return np.array([by_name.get(name, np.nan) for name in names])
