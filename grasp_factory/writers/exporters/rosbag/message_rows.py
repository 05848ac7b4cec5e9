"""What messages hold, as rows of arrays: the inverse of the topics of ``series_topics.py``."""

from __future__ import annotations

from typing import Any


def joint_state(message: Any) -> tuple[Any, ...]:
    """Return position, velocity and effort of a sensor_msgs/JointState."""
    return message.position, message.velocity, message.effort


def position(message: Any) -> tuple[Any, ...]:
    """Return the position of a sensor_msgs/JointState."""
    return (message.position,)


def position_and_effort(message: Any) -> tuple[Any, ...]:
    """Return position and effort of a sensor_msgs/JointState."""
    return message.position, message.effort


def pose(message: Any) -> tuple[Any, ...]:
    """Return the pose of a geometry_msgs/PoseStamped, position and quat_xyzw."""
    return (_pose(message.pose),)


def poses(message: Any) -> tuple[Any, ...]:
    """Return the poses of a geometry_msgs/PoseArray."""
    return ([_pose(each) for each in message.poses],)


def wrench(message: Any) -> tuple[Any, ...]:
    """Return force and torque of a geometry_msgs/WrenchStamped."""
    return ([*_xyz(message.wrench.force), *_xyz(message.wrench.torque)],)


def vector(message: Any) -> tuple[Any, ...]:
    """Return the vector of a geometry_msgs/Vector3Stamped."""
    return (_xyz(message.vector),)


def imu(message: Any) -> tuple[Any, ...]:
    """Return specific force and angular velocity of a sensor_msgs/Imu."""
    return _xyz(message.linear_acceleration), _xyz(message.angular_velocity)


def data(message: Any) -> tuple[Any, ...]:
    """Return the number or the numbers of a message of std_msgs."""
    return (message.data,)


def _xyz(value: Any) -> list[float]:
    return [value.x, value.y, value.z]


def _pose(value: Any) -> list[float]:
    return [*_xyz(value.position), *_xyz(value.orientation), value.orientation.w]
