"""Samples as messages of ROS 2 in CDR, by rosbags: https://ternaris.gitlab.io/rosbags/."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Iterator, Mapping
from typing import Any, NamedTuple

import numpy as np

from grasp_factory.capture.bags.payloads import GRIPPER
from grasp_factory.capture.samples import (
    CameraFrame,
    InertialReading,
    JointReading,
    Payload,
    TactileReading,
    WrenchReading,
)
from grasp_factory.capture.session.camera_info import CameraIntrinsics
from grasp_factory.capture.session.session_file import message_definition
from grasp_factory.capture.session.topic_names import MESSAGES
from grasp_factory.writers.exporters.rosbag.bag_files import ros2_types
from grasp_factory.writers.exporters.rosbag.message_maker import MessageMaker

_NO_ORIENTATION = np.array([-1.0, *[0.0] * 8])
"""``orientation_covariance`` of an IMU that measures no orientation: its first element is -1."""
MessageFields = dict[str, Any]


class Encoded(NamedTuple):
    """A message as bytes."""

    role: str
    data: bytes | memoryview


class MessageEncoder:
    """Makes messages. One thread uses it."""

    def __init__(self) -> None:
        self._store = ros2_types()
        self._make = MessageMaker(self._store)
        self._pieces: Mapping[type[Any], Callable[[Any], Iterator[tuple[str, MessageFields]]]] = {
            CameraFrame: self._camera,
            InertialReading: self._imu,
            WrenchReading: self._wrench,
            TactileReading: self._tactile,
            JointReading: self._joints,
        }

    def encode(
        self, payload: Payload, stamp_ns: int, frame: str, intrinsics: CameraIntrinsics | None
    ) -> Iterator[Encoded]:
        """Yield the messages of a sample.

        Args:
            payload: the sample's.
            stamp_ns: stamp of the header, ns since the epoch.
            frame: frame of the header.
            intrinsics: of a camera, to follow its images as a camera_info.
        """
        header = self._make.header(stamp_ns, frame)
        for role, fields in self._pieces[type(payload)](payload):
            yield self._encoded(role, header=header, **fields)
        if intrinsics is not None and isinstance(payload, CameraFrame):
            yield self._encoded("camera_info", header=header, **_info(intrinsics))

    def prepare(self, roles: Iterable[str]) -> None:
        """Do now what the first message of each role would do, which takes a while."""
        for role in roles:
            self._encoded(role)
            message_definition(MESSAGES[role])

    def text(self, content: Mapping[str, Any]) -> bytes:
        """Return a mapping as JSON in a std_msgs/String."""
        kind = "std_msgs/msg/String"
        message = self._make(kind, data=json.dumps(content, allow_nan=False))
        return bytes(self._store.serialize_cdr(message, kind, little_endian=True))

    def _encoded(self, role: str, **fields: Any) -> Encoded:
        kind = MESSAGES[role]
        message = self._make(kind, **fields)
        return Encoded(role, self._store.serialize_cdr(message, kind, little_endian=True))

    def _camera(self, frame: CameraFrame) -> Iterator[tuple[str, MessageFields]]:
        yield "image", _image(np.ascontiguousarray(frame.rgb, np.uint8), "rgb8")
        if frame.depth is not None:
            yield "depth", _image(np.ascontiguousarray(frame.depth, "<u2"), "16UC1")

    def _imu(self, reading: InertialReading) -> Iterator[tuple[str, MessageFields]]:
        yield (
            "imu",
            {
                "linear_acceleration": self._vector(reading.specific_force),
                "angular_velocity": self._vector(reading.angular_velocity),
                "orientation_covariance": _NO_ORIENTATION,
            },
        )
        if not np.isnan(reading.temperature):
            yield "temperature", {"temperature": float(reading.temperature)}

    def _wrench(self, reading: WrenchReading) -> Iterator[tuple[str, MessageFields]]:
        force, torque = self._vector(reading.wrench[:3]), self._vector(reading.wrench[3:])
        made = self._make("geometry_msgs/msg/Wrench", force=force, torque=torque)
        yield "wrench", {"wrench": made}

    def _tactile(self, reading: TactileReading) -> Iterator[tuple[str, MessageFields]]:
        yield "taxels", _image(np.ascontiguousarray(reading.pressure, "<f4"), "32FC1")

    def _joints(self, reading: JointReading) -> Iterator[tuple[str, MessageFields]]:
        names = [f"joint_{k}" for k in range(1, len(reading.positions) + 1)]
        state = [reading.gripper_width, np.nan, reading.gripper_force]
        columns = [reading.positions, reading.velocities, reading.torques]
        if not (np.isnan(reading.gripper_width) and np.isnan(reading.gripper_force)):
            columns = [np.append(x, last) for x, last in zip(columns, state, strict=True)]
        position, velocity, effort = (np.asarray(x, np.float64) for x in columns)
        shown = [*names, GRIPPER][: len(position)]
        yield (
            "joint_states",
            {"name": shown, "position": position, "velocity": velocity, "effort": effort},
        )
        targets = np.asarray(reading.position_targets, np.float64)
        if not np.isnan(reading.gripper_width_target):
            targets = np.append(targets, reading.gripper_width_target)
        if not np.isnan(targets).all():
            yield "joint_commands", {"name": [*names, GRIPPER][: len(targets)], "position": targets}

    def _vector(self, xyz: Any) -> Any:
        x, y, z = xyz
        return self._make.vector([float(x), float(y), float(z)])


def _image(values: np.ndarray[Any, Any], encoding: str) -> MessageFields:
    height, width = values.shape[:2]
    return {
        "height": height,
        "width": width,
        "encoding": encoding,
        "step": values.nbytes // max(height, 1),
        "data": values.reshape(-1).view(np.uint8),
    }


def _info(found: CameraIntrinsics) -> MessageFields:
    K = np.array([found.fx, 0.0, found.cx, 0.0, found.fy, found.cy, 0.0, 0.0, 1.0])
    return {
        "height": found.height,
        "width": found.width,
        "distortion_model": found.model,
        "d": np.array(found.distortion),
        "k": K,
        "r": np.eye(3).ravel(),
        "p": np.hstack([K.reshape(3, 3), np.zeros((3, 1))]).ravel(),
    }
