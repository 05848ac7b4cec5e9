"""Bare loops of the exports ``rosbag2`` and ``rosbag1``: the same messages from rosbags itself."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rosbags.rosbag1 import Writer as Ros1Writer
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore

from grasp_factory.core.episode import Episode
from grasp_factory.dataset.dataset import Dataset

Sent = tuple[int, str, Any]
"""Time (ns), topic, message."""
NONE, NINE, EYE = np.empty(0), np.zeros(9), np.eye(3).ravel()


def rosbag2(dataset: Dataset, out: Path) -> None:
    """Write an MCAP file for each episode."""
    out.mkdir()
    store = get_typestore(Stores.ROS2_HUMBLE)
    made = BareMessages(store)
    for i, episode in enumerate(dataset):
        with Writer(out / str(i), version=8, storage_plugin=StoragePlugin.MCAP) as writer:
            write_messages(writer, made.messages(episode), store, store.serialize_cdr)
            json.dumps(episode.spec.to_json())


def rosbag1(dataset: Dataset, out: Path) -> None:
    """Write a bag of ROS 1 for each episode."""
    out.mkdir()
    store = get_typestore(Stores.ROS1_NOETIC)
    tf = "geometry_msgs/TransformStamped[] transforms"
    store.register(get_types_from_msg(tf, "tf2_msgs/msg/TFMessage"))
    made = BareMessages(store, first=(0,))
    for i, episode in enumerate(dataset):
        with Ros1Writer(out / f"{i}.bag") as writer:
            write_messages(writer, made.messages(episode), store, store.serialize_ros1)
            json.dumps(episode.spec.to_json())


def write_messages(
    writer: Any, sent: Iterator[Sent], store: Typestore, serialize: Callable[[Any, str], Any]
) -> None:
    found: dict[str, Any] = {}
    for at, topic, message in sent:
        kind = message.__msgtype__
        if topic not in found:
            found[topic] = writer.add_connection(topic, kind, typestore=store)
        writer.write(found[topic], at, serialize(message, kind))


class BareMessages:
    """Makes the messages of an episode."""

    def __init__(self, store: Typestore, first: tuple[int, ...] = ()) -> None:
        """Use the types of a version of ROS; ``first`` stands before a header's time."""
        self.types = {name.rpartition("/")[2]: kind for name, kind in store.types.items()}
        self.types["Time"] = store.types["builtin_interfaces/msg/Time"]
        self.first = first

    def messages(self, episode: Episode) -> Iterator[Sent]:
        streams = episode.streams
        wide = {name: values.astype(np.float64) for name, values in streams.items()}
        layouts = {name: self.layout(values.shape[1:]) for name, values in streams.items()}
        for k, seconds in enumerate(streams["timestamp"].tolist()):
            at = round(seconds * 1e9) + 10**9
            yield from self.joints(at, k, wide)
            yield from self.bodies(at, {name: values[k] for name, values in streams.items()})
            for name in ("timestamp", "shake_level", "reward", "phase"):
                kind = {"reward": "Float32", "phase": "UInt8"}.get(name, "Float64")
                yield at, f"/{name}", self.types[kind](streams[name][k].item())
            for name in ("position", "force", "normal", "depth", "body"):
                values = streams[f"tactile_{name}"][k].ravel()
                kind = "UInt8MultiArray" if name == "body" else "Float32MultiArray"
                yield at, f"/tactile_{name}", self.types[kind](layouts[f"tactile_{name}"], values)
        for k, seconds in enumerate(episode.imu["timestamp"].tolist()):
            at = round(seconds * 1e9) + 10**9
            parts = (episode.imu[name][k] for name in ("specific_force", "angular_velocity"))
            force, speed = (self.types["Vector3"](*part.tolist()) for part in parts)
            turn = self.types["Quaternion"](0.0, 0.0, 0.0, 1.0)
            yield (
                at,
                "/imu",
                self.types["Imu"](self.header(at, "imu"), turn, NINE, speed, NINE, force, NINE),
            )
            yield at, "/imu_time", self.types["Float64"](seconds)
        for name, frames in episode.cameras.items():
            groups = {"rgb": frames.rgb, "depth": frames.depth, "labels": frames.segmentation}
            groups["video"] = episode.videos.get(f"{name}/rgb", frames.rgb[:0])
            for kind, group in groups.items():
                yield from self.images(f"/{name}/{kind}", group, frames.intrinsics)

    def joints(self, at: int, k: int, wide: dict[str, Any]) -> Iterator[Sent]:
        made = self.types["JointState"]
        names = ["joint"] * wide["joint_positions"].shape[1]
        state = (wide[f"joint_{name}"][k] for name in ("positions", "velocities", "torques"))
        yield at, "/joint_states", made(self.header(at), names, *state)
        yield (
            at,
            "/joint_targets",
            made(self.header(at), names, wide["joint_position_targets"][k], NONE, NONE),
        )
        width, force = (wide[f"gripper_{name}"][k : k + 1] for name in ("width", "force"))
        yield at, "/gripper", made(self.header(at), ["width"], width, NONE, force)
        target = wide["gripper_width_target"][k : k + 1]
        yield at, "/gripper_target", made(self.header(at), ["width"], target, NONE, NONE)

    def bodies(self, at: int, record: dict[str, Any]) -> Iterator[Sent]:
        tcp, objects = record["tcp_pose"].tolist(), record["object_pose"].tolist()
        yield at, "/tcp_pose", self.types["PoseStamped"](self.header(at), self.pose(tcp))
        yield (
            at,
            "/object_poses",
            self.types["PoseArray"](self.header(at), [self.pose(v) for v in objects]),
        )
        yield at, "/tf", self.types["TFMessage"]([self.moved(at, v) for v in (tcp, *objects)])
        for k, wrench in enumerate((record["wrist_wrench"], *record["tactile_wrench"])):
            halves = (self.types["Vector3"](*half) for half in wrench.reshape(2, 3).tolist())
            yield (
                at,
                f"/wrench_{k}",
                self.types["WrenchStamped"](self.header(at), self.types["Wrench"](*halves)),
            )
        force = self.types["Vector3"](*record["hand_force"].tolist())
        yield at, "/hand_force", self.types["Vector3Stamped"](self.header(at), force)

    def images(self, topic: str, group: NDArray[Any], K: NDArray[Any]) -> Iterator[Sent]:
        for k, image in enumerate(group):
            at, (height, width) = 10**9 + k, image.shape[:2]
            data, step = image.reshape(-1).view(np.uint8), image.nbytes // height
            yield (
                at,
                topic,
                self.types["Image"](self.header(at), height, width, "rgb8", 0, step, data),
            )
            roi, P = self.types["RegionOfInterest"](0, 0, 0, 0, False), np.zeros(12)
            info = (height, width, "plumb_bob", np.zeros(5), K.ravel(), EYE, P, 0, 0, roi)
            yield at, f"{topic}/camera_info", self.types["CameraInfo"](self.header(at), *info)
            pose = self.types["Float64MultiArray"](self.layout((4, 4)), np.eye(4).ravel())
            yield at, f"{topic}/T_world_camera", pose

    def header(self, at: int, frame: str = "world") -> Any:
        return self.types["Header"](*self.first, self.types["Time"](*divmod(at, 10**9)), frame)

    def pose(self, values: list[float]) -> Any:
        return self.types["Pose"](
            self.types["Point"](*values[:3]), self.types["Quaternion"](*values[3:])
        )

    def moved(self, at: int, values: list[float]) -> Any:
        turned = self.types["Transform"](
            self.types["Vector3"](*values[:3]), self.types["Quaternion"](*values[3:])
        )
        return self.types["TransformStamped"](self.header(at), "frame", turned)

    def layout(self, shape: tuple[int, ...]) -> Any:
        dims = [self.types["MultiArrayDimension"]("axis", size, 0) for size in shape]
        return self.types["MultiArrayLayout"](dims, 0)
