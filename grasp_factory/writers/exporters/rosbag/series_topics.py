"""The time series of an episode as messages; a topic is a row of ``SERIES``.

An array that no row names becomes an array message: see ``array_topics.py``. Definitions of the
messages: https://github.com/ros2/common_interfaces. Frames: ``world``, ``tcp``, ``imu`` and
``ft_sensor`` (both at the wrist flange), ``left_pad``, ``right_pad``, and ``object_0``, the target.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from grasp_factory.core.geometry import Array
from grasp_factory.writers.exporters.rosbag import message_rows
from grasp_factory.writers.exporters.rosbag.array_topics import array_messages, constant_message
from grasp_factory.writers.exporters.rosbag.topics import BagScene, StampedMessage, Topic, stamps

Fields = dict[str, Any]
_NO_ORIENTATION = np.array([-1.0, *[0.0] * 8])
"""``orientation_covariance`` of an IMU that measures no orientation: its first element is -1."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SeriesTopic:
    """A topic with a message for each sample of some arrays."""

    name: str
    kind: str
    """Type of its messages."""
    arrays: tuple[str, ...]
    """Their paths in the store."""
    fields: Callable[..., Fields]
    """Returns a message's fields from the scene, the stamp, and a row (n,) of each array."""
    rows: Callable[[Any], tuple[Any, ...]] | None
    """Returns from a message what ``fields`` made it of; None if other topics hold the same."""
    frame: str = "world"
    """The frame of its header; empty for a message without a header."""
    pad: int | None = None
    """The part of the arrays that the topic has, along the axis of the pads; None for all."""


def _joints(scene: BagScene, stamp: int, position: Array, velocity: Array, effort: Array) -> Fields:
    return {"position": position, "velocity": velocity, "effort": effort, "name": scene.joint_names}


def _joint_targets(scene: BagScene, stamp: int, position: Array) -> Fields:
    return {"position": position, "name": scene.joint_names}


def _gripper(scene: BagScene, stamp: int, width: Array, force: Array) -> Fields:
    return {"position": width, "effort": force, "name": ["gripper_width"]}


def _gripper_target(scene: BagScene, stamp: int, width: Array) -> Fields:
    return {"position": width, "name": ["gripper_width"]}


def _pose(scene: BagScene, stamp: int, pose: Array) -> Fields:
    return {"pose": scene.make.pose(pose.tolist())}


def _poses(scene: BagScene, stamp: int, poses: Array) -> Fields:
    return {"poses": [scene.make.pose(pose) for pose in poses.reshape(-1, 7).tolist()]}


def _transforms(scene: BagScene, stamp: int, tcp: Array, objects: Array) -> Fields:
    poses = {"tcp": tcp.tolist()}
    poses |= {f"object_{k}": pose for k, pose in enumerate(objects.reshape(-1, 7).tolist())}
    if scene.episode.is_real:
        poses = {name: pose for name, pose in poses.items() if not any(map(math.isnan, pose))}
    made = [scene.make.transform(stamp, "world", name, pose) for name, pose in poses.items()]
    return {"transforms": made}


def _wrench(scene: BagScene, stamp: int, wrench: Array) -> Fields:
    force, torque = (scene.make.vector(half.tolist()) for half in (wrench[:3], wrench[3:]))
    return {"wrench": scene.make("geometry_msgs/msg/Wrench", force=force, torque=torque)}


def _vector(scene: BagScene, stamp: int, vector: Array) -> Fields:
    return {"vector": scene.make.vector(vector.tolist())}


def _imu(scene: BagScene, stamp: int, force: Array, angular: Array) -> Fields:
    return {
        "linear_acceleration": scene.make.vector(force.tolist()),
        "angular_velocity": scene.make.vector(angular.tolist()),
        "orientation_covariance": _NO_ORIENTATION,
    }


_JOINT_STATE = "sensor_msgs/msg/JointState"
_WRENCH = "geometry_msgs/msg/WrenchStamped"

SERIES = (
    SeriesTopic(
        name="/joint_states",
        kind=_JOINT_STATE,
        arrays=("streams/joint_positions", "streams/joint_velocities", "streams/joint_torques"),
        fields=_joints,
        rows=message_rows.joint_state,
    ),
    SeriesTopic(
        name="/joint_targets",
        kind=_JOINT_STATE,
        arrays=("streams/joint_position_targets",),
        fields=_joint_targets,
        rows=message_rows.position,
    ),
    SeriesTopic(
        name="/gripper/state",
        kind=_JOINT_STATE,
        arrays=("streams/gripper_width", "streams/gripper_force"),
        fields=_gripper,
        rows=message_rows.position_and_effort,
    ),
    SeriesTopic(
        name="/gripper/target",
        kind=_JOINT_STATE,
        arrays=("streams/gripper_width_target",),
        fields=_gripper_target,
        rows=message_rows.position,
    ),
    SeriesTopic(
        name="/tcp_pose",
        kind="geometry_msgs/msg/PoseStamped",
        arrays=("streams/tcp_pose",),
        fields=_pose,
        rows=message_rows.pose,
    ),
    SeriesTopic(
        name="/object_poses",
        kind="geometry_msgs/msg/PoseArray",
        arrays=("streams/object_pose",),
        fields=_poses,
        rows=message_rows.poses,
    ),
    SeriesTopic(
        name="/tf",
        kind="tf2_msgs/msg/TFMessage",
        arrays=("streams/tcp_pose", "streams/object_pose"),
        fields=_transforms,
        rows=None,
        frame="",
    ),
    SeriesTopic(
        name="/wrist/wrench",
        kind=_WRENCH,
        arrays=("streams/wrist_wrench",),
        fields=_wrench,
        rows=message_rows.wrench,
        frame="ft_sensor",
    ),
    SeriesTopic(
        name="/left_pad/wrench",
        kind=_WRENCH,
        arrays=("streams/tactile_wrench",),
        fields=_wrench,
        rows=message_rows.wrench,
        pad=0,
        frame="left_pad",
    ),
    SeriesTopic(
        name="/right_pad/wrench",
        kind=_WRENCH,
        arrays=("streams/tactile_wrench",),
        fields=_wrench,
        rows=message_rows.wrench,
        pad=1,
        frame="right_pad",
    ),
    SeriesTopic(
        name="/hand_force",
        kind="geometry_msgs/msg/Vector3Stamped",
        arrays=("streams/hand_force",),
        fields=_vector,
        rows=message_rows.vector,
    ),
    SeriesTopic(
        name="/imu/data",
        kind="sensor_msgs/msg/Imu",
        arrays=("imu/specific_force", "imu/angular_velocity"),
        fields=_imu,
        rows=message_rows.imu,
        frame="imu",
    ),
    SeriesTopic(
        name="/force_torque/wrench",
        kind=_WRENCH,
        arrays=("force_torque/wrench",),
        fields=_wrench,
        rows=message_rows.wrench,
        frame="ft_sensor",
    ),
    SeriesTopic(
        name="/joints/state",
        kind=_JOINT_STATE,
        arrays=("joints/positions", "joints/velocities", "joints/torques"),
        fields=_joints,
        rows=message_rows.joint_state,
    ),
)


def series_messages(scene: BagScene, group: str) -> list[Iterator[StampedMessage]]:
    """Return the messages of each topic of a group of the store, each in the samples' order."""
    arrays = {f"{group}/{name}": rows for name, rows in scene.episode.series[group].items()}
    times = stamps(arrays[f"{group}/timestamp"])
    rows = [row for row in SERIES if all(path in arrays for path in row.arrays)]
    standard = {path for row in rows for path in row.arrays}
    found = [_messages(scene, row, times, arrays) for row in rows]
    for path in sorted(arrays.keys() - standard):
        if scene.fields[path].length_column:
            found.append(array_messages(scene, path, f"/{path}", times, arrays[path]))
        else:
            found.append(iter([constant_message(scene, path, arrays[path])]))
    return found


def _messages(
    scene: BagScene, row: SeriesTopic, times: Sequence[int], arrays: Mapping[str, NDArray[Any]]
) -> Iterator[StampedMessage]:
    topic = Topic(name=row.name, kind=row.kind)
    columns = [_rows(part_of(row, arrays[path])) for path in row.arrays]
    for stamp, *values in zip(times, *columns, strict=True):
        fields = row.fields(scene, stamp, *values)
        if row.frame:
            fields["header"] = scene.make.header(stamp, row.frame)
        yield StampedMessage(stamp, topic, scene.make(row.kind, **fields))


def part_of(row: SeriesTopic, values: NDArray[Any]) -> NDArray[Any]:
    """Return what a topic has of an array: all of it, or one pad's."""
    return values if row.pad is None else values[:, row.pad]


def _rows(values: NDArray[Any]) -> Array:
    """Return each sample as one row, (samples, numbers)."""
    return values.reshape(len(values), math.prod(values.shape[1:])).astype(np.float64)
