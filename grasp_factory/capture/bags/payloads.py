"""Messages of ROS as payloads of devices."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from grasp_factory.capture.bags.pixel_decoding import (
    DecodedImage,
    decode_compressed_image,
    decode_image,
)
from grasp_factory.capture.samples import (
    CameraFrame,
    DeviceKind,
    InertialReading,
    JointReading,
    Payload,
    TactileReading,
    Vector,
    WrenchReading,
)

GRIPPER = "gripper"
"""Name of the joint whose position is the gripper's width, m."""
_IMAGES: Mapping[str, Callable[[Any], DecodedImage]] = {
    "sensor_msgs/msg/Image": decode_image,
    "sensor_msgs/msg/CompressedImage": decode_compressed_image,
}


def colour_of(kind: str, message: Any) -> CameraFrame:
    """Return a colour image of a message of a type.

    Raises:
        ValueError: if it is no such image. All functions here raise it for what does not fit.
    """
    image = _IMAGES[kind](message)
    if image.is_depth or image.values.dtype != np.uint8:
        raise ValueError("a depth image, or one of 16 bits, where a colour image should be")
    values = image.values
    return CameraFrame(rgb=np.stack([values] * 3, axis=-1) if values.ndim == 2 else values)


def depth_of(kind: str, message: Any) -> NDArray[np.uint16]:
    """Return a depth image, mm."""
    image = _IMAGES[kind](message)
    if not image.is_depth:
        raise ValueError("a colour image where a depth image should be")
    return image.values


def imu_of(kind: str, message: Any) -> InertialReading:
    """Return a reading of an IMU."""
    return InertialReading(
        specific_force=_xyz(message.linear_acceleration),
        angular_velocity=_xyz(message.angular_velocity),
    )


def wrench_of(kind: str, message: Any) -> WrenchReading:
    """Return a wrench."""
    force, torque = _xyz(message.wrench.force), _xyz(message.wrench.torque)
    return WrenchReading(wrench=np.concatenate([force, torque]))


def taxels_of(kind: str, message: Any) -> TactileReading:
    """Return the values of taxels."""
    if message.encoding != "32FC1":
        raise ValueError("taxels are images of 32FC1")
    height, width, step = int(message.height), int(message.width), int(message.step)
    data = np.asarray(message.data, np.uint8)
    if not (0 < height and 0 < 4 * width <= step and data.size >= height * step):
        raise ValueError(f"{width} x {height} taxels in {data.size} bytes")
    rows = np.ascontiguousarray(data[: height * step].reshape(height, step)[:, : 4 * width])
    values = rows.view(">f4" if message.is_bigendian else "<f4")
    return TactileReading(pressure=values.astype(np.float64))


def joints_of(kind: str, message: Any) -> JointReading:
    """Return the state of joints; what the message does not have is NaN."""
    names = list(message.name)
    columns = [_column(message, name, len(names)) for name in ("position", "velocity", "effort")]
    is_arm = np.array([name != GRIPPER for name in names], bool)
    position, velocity, effort = (column[is_arm] for column in columns)
    grip = names.index(GRIPPER) if GRIPPER in names else None
    return JointReading(
        positions=position,
        velocities=velocity,
        torques=effort,
        position_targets=np.full(len(position), math.nan),
        gripper_width=math.nan if grip is None else float(columns[0][grip]),
        gripper_force=math.nan if grip is None else float(columns[2][grip]),
    )


def _column(message: Any, name: str, count: int) -> Vector:
    values = np.asarray(getattr(message, name), np.float64)
    if not len(values):
        return np.full(count, math.nan)
    if len(values) != count:
        raise ValueError(f"{count} joints with {len(values)} values of {name}")
    return values


def _xyz(vector: Any) -> Vector:
    return np.array([vector.x, vector.y, vector.z], np.float64)


PAYLOADS: Mapping[DeviceKind, tuple[tuple[str, ...], Callable[[str, Any], Payload]]] = {
    DeviceKind.CAMERA: (tuple(_IMAGES), colour_of),
    DeviceKind.IMU: (("sensor_msgs/msg/Imu",), imu_of),
    DeviceKind.FORCE_TORQUE: (("geometry_msgs/msg/WrenchStamped",), wrench_of),
    DeviceKind.TACTILE: (("sensor_msgs/msg/Image",), taxels_of),
    DeviceKind.JOINTS: (("sensor_msgs/msg/JointState",), joints_of),
}
"""By kind of device: types of messages, and the function that makes a payload."""
