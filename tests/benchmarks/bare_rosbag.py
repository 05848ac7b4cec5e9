"""A bare loop of the export ``rosbag2``: the same messages from rosbags itself, as MCAP files."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

from grasp_factory.core.episode import Episode
from grasp_factory.dataset.dataset import Dataset

Sent = tuple[int, str, Any]
"""Time (ns), topic, message."""
STORE = get_typestore(Stores.ROS2_HUMBLE)
TYPES = {name.rpartition("/")[2]: kind for name, kind in STORE.types.items()}
NONE, NINE, EYE = np.empty(0), np.zeros(9), np.eye(3).ravel()


def rosbag2(dataset: Dataset, out: Path) -> None:
    """Write an MCAP file for each episode."""
    out.mkdir()
    for i, episode in enumerate(dataset):
        path = out / str(i)
        with Writer(path, version=8, storage_plugin=StoragePlugin.MCAP) as writer:
            found: dict[str, Any] = {}
            for at, topic, message in messages(episode):
                kind = message.__msgtype__
                if topic not in found:
                    found[topic] = writer.add_connection(topic, kind, typestore=STORE)
                writer.write(found[topic], at, STORE.serialize_cdr(message, kind))
            json.dumps(episode.spec.to_json())


def messages(episode: Episode) -> Iterator[Sent]:
    streams = episode.streams
    wide = {name: values.astype(np.float64) for name, values in streams.items()}
    layouts = {name: layout(values.shape[1:]) for name, values in streams.items()}
    for k, seconds in enumerate(streams["timestamp"].tolist()):
        at = round(seconds * 1e9) + 10**9
        yield from joints(at, k, wide)
        yield from bodies(at, {name: values[k] for name, values in streams.items()})
        for name in ("timestamp", "shake_level", "reward", "phase"):
            kind = {"reward": "Float32", "phase": "UInt8"}.get(name, "Float64")
            yield at, f"/{name}", TYPES[kind](streams[name][k].item())
        for name in ("position", "force", "normal", "depth", "body"):
            values = streams[f"tactile_{name}"][k].ravel()
            kind = "UInt8MultiArray" if name == "body" else "Float32MultiArray"
            yield at, f"/tactile_{name}", TYPES[kind](layouts[f"tactile_{name}"], values)
    for k, seconds in enumerate(episode.imu["timestamp"].tolist()):
        at = round(seconds * 1e9) + 10**9
        parts = (episode.imu[name][k] for name in ("specific_force", "angular_velocity"))
        force, speed = (TYPES["Vector3"](*part.tolist()) for part in parts)
        turn = TYPES["Quaternion"](0.0, 0.0, 0.0, 1.0)
        yield at, "/imu", TYPES["Imu"](header(at, "imu"), turn, NINE, speed, NINE, force, NINE)
        yield at, "/imu_time", TYPES["Float64"](seconds)
    for name, frames in episode.cameras.items():
        groups = {"rgb": frames.rgb, "depth": frames.depth, "labels": frames.segmentation}
        groups["video"] = episode.videos.get(f"{name}/rgb", frames.rgb[:0])
        for kind, group in groups.items():
            yield from images(f"/{name}/{kind}", group, frames.intrinsics)


def joints(at: int, k: int, wide: dict[str, Any]) -> Iterator[Sent]:
    made = TYPES["JointState"]
    names = ["joint"] * wide["joint_positions"].shape[1]
    state = (wide[f"joint_{name}"][k] for name in ("positions", "velocities", "torques"))
    yield at, "/joint_states", made(header(at), names, *state)
    yield (
        at,
        "/joint_targets",
        made(header(at), names, wide["joint_position_targets"][k], NONE, NONE),
    )
    width, force = (wide[f"gripper_{name}"][k : k + 1] for name in ("width", "force"))
    yield at, "/gripper", made(header(at), ["width"], width, NONE, force)
    target = wide["gripper_width_target"][k : k + 1]
    yield at, "/gripper_target", made(header(at), ["width"], target, NONE, NONE)


def bodies(at: int, record: dict[str, Any]) -> Iterator[Sent]:
    tcp, objects = record["tcp_pose"].tolist(), record["object_pose"].tolist()
    yield at, "/tcp_pose", TYPES["PoseStamped"](header(at), pose(tcp))
    yield at, "/object_poses", TYPES["PoseArray"](header(at), [pose(v) for v in objects])
    yield at, "/tf", TYPES["TFMessage"]([moved(at, v) for v in (tcp, *objects)])
    for k, wrench in enumerate((record["wrist_wrench"], *record["tactile_wrench"])):
        halves = (TYPES["Vector3"](*half) for half in wrench.reshape(2, 3).tolist())
        yield at, f"/wrench_{k}", TYPES["WrenchStamped"](header(at), TYPES["Wrench"](*halves))
    force = TYPES["Vector3"](*record["hand_force"].tolist())
    yield at, "/hand_force", TYPES["Vector3Stamped"](header(at), force)


def images(topic: str, group: NDArray[Any], K: NDArray[Any]) -> Iterator[Sent]:
    for k, image in enumerate(group):
        at, (height, width) = 10**9 + k, image.shape[:2]
        data, step = image.reshape(-1).view(np.uint8), image.nbytes // height
        yield at, topic, TYPES["Image"](header(at), height, width, "rgb8", 0, step, data)
        roi, P = TYPES["RegionOfInterest"](0, 0, 0, 0, False), np.zeros(12)
        info = (height, width, "plumb_bob", np.zeros(5), K.ravel(), EYE, P, 0, 0, roi)
        yield at, f"{topic}/camera_info", TYPES["CameraInfo"](header(at), *info)
        pose = TYPES["Float64MultiArray"](layout((4, 4)), np.eye(4).ravel())
        yield at, f"{topic}/T_world_camera", pose


def header(at: int, frame: str = "world") -> Any:
    return TYPES["Header"](TYPES["Time"](*divmod(at, 10**9)), frame)


def pose(values: list[float]) -> Any:
    return TYPES["Pose"](TYPES["Point"](*values[:3]), TYPES["Quaternion"](*values[3:]))


def moved(at: int, values: list[float]) -> Any:
    turned = TYPES["Transform"](TYPES["Vector3"](*values[:3]), TYPES["Quaternion"](*values[3:]))
    return TYPES["TransformStamped"](header(at), "frame", turned)


def layout(shape: tuple[int, ...]) -> Any:
    dims = [TYPES["MultiArrayDimension"]("axis", size, 0) for size in shape]
    return TYPES["MultiArrayLayout"](dims, 0)
