"""Drivers that read topics of ROS 2: their settings and rows."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from grasp_factory.capture.devices.base import DeviceModel
from grasp_factory.capture.samples import DeviceKind
from grasp_factory.core.serialization import check, check_range, normalise

_LARGEST_DOMAIN = 232


@dataclass(frozen=True, slots=True, kw_only=True)
class Ros2Settings:
    """Settings of all drivers of topics."""

    topic: str
    domain_id: int = 0
    """``ROS_DOMAIN_ID`` of the publisher."""
    interface: str = "lo"
    """Network interface; ``lo`` reaches programs on this machine only."""
    match_s: float = 10.0
    """How long to wait for a publisher, seconds."""
    reconnect_s: float = 10.0
    """How long the topic may be silent, seconds."""

    def __post_init__(self) -> None:
        normalise(self)
        check_range(self, "domain_id", 0, _LARGEST_DOMAIN)
        check_range(self, "match_s", 0.0, 3600.0, "s")
        check_range(self, "reconnect_s", 0.1, 3600.0, "s")

    @property
    def topics(self) -> tuple[str, ...]:
        """All topics that the driver reads."""
        return (self.topic,)


@dataclass(frozen=True, slots=True, kw_only=True)
class Ros2CameraSettings(Ros2Settings):
    """Settings of ``ros2_camera``: ``topic`` has colour images."""

    depth_topic: str = ""
    """Depth images that are aligned to the colour images; empty for none."""
    depth_tolerance_s: float = 0.005
    """Largest difference between the stamps of a colour and a depth image."""

    def __post_init__(self) -> None:
        Ros2Settings.__post_init__(self)
        check_range(self, "depth_tolerance_s", 0.0, 1.0, "s")
        check(self.depth_topic != self.topic, "depth_topic", self.depth_topic, "another topic")

    @property
    def topics(self) -> tuple[str, ...]:
        """All topics that the driver reads."""
        return (self.topic, self.depth_topic) if self.depth_topic else (self.topic,)


@dataclass(frozen=True, slots=True, kw_only=True)
class Ros2JointSettings(Ros2Settings):
    """Settings of ``ros2_joints``: ``topic`` has measured joint states."""

    command_topic: str = ""
    """Joint states that are commanded; empty for none."""
    gripper: str = "gripper"
    """The joint whose position is the gripper's width, m, and whose effort is its force, N."""

    def __post_init__(self) -> None:
        Ros2Settings.__post_init__(self)
        is_other = self.command_topic != self.topic
        check(is_other, "command_topic", self.command_topic, "another topic")

    @property
    def topics(self) -> tuple[str, ...]:
        """All topics that the driver reads."""
        return (self.topic, self.command_topic) if self.command_topic else (self.topic,)


def _model(
    name: str, kind: DeviceKind, what: str, implementation: str, settings: type[Any] = Ros2Settings
) -> DeviceModel:
    return DeviceModel(
        name=name,
        kind=kind,
        description=f"{what} of ROS 2, without a ROS installation",
        settings=settings,
        implementation=f"grasp_factory.capture.devices.ros2_topics:{implementation}",
        modules=("cyclonedds", "rosbags"),
        extra="ros2",
    )


ROS2_CAMERA_MODEL = _model(
    "ros2_camera",
    DeviceKind.CAMERA,
    "image topics, colour and depth,",
    "Ros2Camera",
    Ros2CameraSettings,
)
ROS2_IMU_MODEL = _model("ros2_imu", DeviceKind.IMU, "a topic of sensor_msgs/Imu", "Ros2Imu")
ROS2_FORCE_TORQUE_MODEL = _model(
    "ros2_force_torque",
    DeviceKind.FORCE_TORQUE,
    "a topic of geometry_msgs/WrenchStamped",
    "Ros2ForceTorque",
)
ROS2_JOINTS_MODEL = _model(
    "ros2_joints",
    DeviceKind.JOINTS,
    "topics of sensor_msgs/JointState, measured and commanded,",
    "Ros2Joints",
    Ros2JointSettings,
)
ROS2_MODELS = (ROS2_CAMERA_MODEL, ROS2_IMU_MODEL, ROS2_FORCE_TORQUE_MODEL, ROS2_JOINTS_MODEL)
