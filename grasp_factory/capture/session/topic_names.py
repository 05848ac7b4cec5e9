"""The topics of a session: which there are by kind of device, their messages, their names."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

from grasp_factory.capture.devices.base import DeviceModel
from grasp_factory.capture.samples import DeviceKind
from grasp_factory.capture.session.session_config import SessionConfig, SessionNames
from grasp_factory.errors import ConfigError, did_you_mean, shown

EVENTS = "/events"
"""The topic of events, std_msgs/String with JSON."""
MESSAGES: Mapping[str, str] = {
    "image": "sensor_msgs/msg/Image",
    "depth": "sensor_msgs/msg/Image",
    "camera_info": "sensor_msgs/msg/CameraInfo",
    "imu": "sensor_msgs/msg/Imu",
    "temperature": "sensor_msgs/msg/Temperature",
    "wrench": "geometry_msgs/msg/WrenchStamped",
    "taxels": "sensor_msgs/msg/Image",
    "joint_states": "sensor_msgs/msg/JointState",
    "joint_commands": "sensor_msgs/msg/JointState",
}
"""The type of messages by role."""
ROLES: Mapping[DeviceKind, tuple[str, ...]] = {
    DeviceKind.CAMERA: ("image", "depth", "camera_info"),
    DeviceKind.IMU: ("imu", "temperature"),
    DeviceKind.FORCE_TORQUE: ("wrench",),
    DeviceKind.TACTILE: ("taxels",),
    DeviceKind.JOINTS: ("joint_states", "joint_commands"),
}
"""What a device of a kind sends."""
QUANTITIES: Mapping[DeviceKind, tuple[str, ...]] = {
    DeviceKind.CAMERA: (),
    DeviceKind.IMU: ("specific_force", "angular_velocity"),
    DeviceKind.FORCE_TORQUE: ("force", "torque"),
    DeviceKind.TACTILE: ("pressure",),
    DeviceKind.JOINTS: ("torques",),
}
"""What can have a full scale, by kind."""
_ARTICLE: Mapping[str, str] = {
    "image": "/camera/color/image_raw",
    "depth": "/camera/aligned_depth_to_color/image_raw",
    "camera_info": "/camera/color/camera_info",
    "imu": "/imu/data",
    "temperature": "/imu/temperature",
    "wrench": "/wrench",
    "taxels": "/taxels",
    "joint_states": "/joint_states",
    "joint_commands": "/joint_commands",
}
FIXED: Mapping[SessionNames, Mapping[str, str]] = MappingProxyType(
    {
        SessionNames.PLAIN: {},
        SessionNames.ARTICLE: _ARTICLE,
        SessionNames.ARTICLE_SYNC: {**_ARTICLE, "imu": "/imu/data_raw"},
    }
)
"""Topics that do not depend on the device's name."""


def topics_of(
    config: SessionConfig, models: Mapping[str, DeviceModel]
) -> dict[str, dict[str, str]]:
    """Return the topic of each role of each device.

    Raises:
        ConfigError: for a role or a quantity that the device has not, or a name that is taken.
    """
    found: dict[str, dict[str, str]] = {}
    taken = {EVENTS: "the events"}
    for name, device in config.devices.items():
        kind = models[name].kind
        _check_keys(f"devices.{name}.topics", device.topics, ROLES[kind])
        _check_keys(f"devices.{name}.full_scale", device.full_scale, QUANTITIES[kind])
        usual = {role: f"/{name}/{role}" for role in ROLES[kind]} | {
            role: FIXED[config.names][role] for role in ROLES[kind] if FIXED[config.names]
        }
        found[name] = usual | dict(device.topics)
        for role, topic in found[name].items():
            if topic in taken:
                raise ConfigError(
                    f"devices.{name}: its topic {topic} is that of {taken[topic]}; give it another"
                    f" name: devices.{name}.topics.{role}"
                )
            taken[topic] = f"devices.{name}"
    return found


def _check_keys(where: str, given: Mapping[str, object], valid: tuple[str, ...]) -> None:
    for key in given:
        if key not in valid:
            raise ConfigError(
                f"unknown key {shown(f'{where}.{key}')}{did_you_mean(key, valid)}"
                f" (valid: {', '.join(valid) or 'none'})"
            )
