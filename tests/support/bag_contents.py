"""What a bag of an episode must hold, field by field, from the arrays of the store."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from grasp_factory.core.episode import Episode
from grasp_factory.core.geometry import Array, pose_matrices
from grasp_factory.dataset.dataset import Dataset

START_NS = 10**9
JOINTS = {
    "/joint_states|position": "joint_positions",
    "/joint_states|velocity": "joint_velocities",
    "/joint_states|effort": "joint_torques",
    "/joint_targets|position": "joint_position_targets",
    "/gripper/state|position": "gripper_width",
    "/gripper/state|effort": "gripper_force",
    "/gripper/target|position": "gripper_width_target",
}
WRENCHES = {
    "/wrist/wrench": ("ft_sensor", "wrist_wrench", ()),
    "/left_pad/wrench": ("left_pad", "tactile_wrench", (0,)),
    "/right_pad/wrench": ("right_pad", "tactile_wrench", (1,)),
}
IMU = {"specific_force": "linear_acceleration", "angular_velocity": "angular_velocity"}
PLAIN = (
    *("timestamp", "phase", "shake_level", "reward", "tactile_position", "tactile_force"),
    *("tactile_normal", "tactile_depth", "tactile_body"),
)
"""Arrays that are numbers or arrays of std_msgs."""
XYZ, XYZW = ("x", "y", "z"), ("x", "y", "z", "w")

Read = Mapping[str, NDArray[Any]]
Compared = Iterator[tuple[str, NDArray[Any], NDArray[Any]]]
"""Path of an array, its values in the store, and those in the bag."""


def equal_values(dataset: Dataset, export: Path, read: Read) -> int:
    """Compare all bags of an export with the store; return the number of values compared."""
    seen = 0
    for place, episode in enumerate(dataset):
        bag = f"{place:06d}|"
        fields = {key.removeprefix(bag): read[key] for key in read if key.startswith(bag)}
        seen += equal_episode(episode, fields)
        check_transforms(episode, fields)
    return seen


def equal_episode(episode: Episode, read: Read) -> int:
    """Compare a bag with its episode; return the number of values compared."""
    arrays = {path: array for path, array in episode.contents().items() if array.size}
    wanted = {path for path in arrays if not path.startswith("episodes/")}
    seen, values_seen = set[str](), 0
    for path, stored, found in compared(episode, read):
        np.testing.assert_array_equal(found.reshape(stored.shape), stored, err_msg=path)
        assert found.dtype.kind == stored.dtype.kind or found.dtype.kind in "iu", path
        seen.add(path)
        values_seen += stored.size
    assert seen == wanted
    check_stamps(episode, read)
    return values_seen + equal_columns(episode, json.loads(str(read["/episode|data"][0])))


def compared(episode: Episode, read: Read) -> Compared:
    """Yield each array of the store beside that of the bag."""
    streams, imu = episode.streams, episode.imu
    if episode.n_steps:
        for key, name in JOINTS.items():
            yield f"streams/{name}", streams[name], read[key]
        for topic, (frame, name, index) in WRENCHES.items():
            halves = [parts(read, f"{topic}|wrench.{half}", XYZ) for half in ("force", "torque")]
            assert set(read[f"{topic}|header.frame_id"]) == {frame}
            stored = streams[name][:, *index]
            yield f"streams/{name}", stored, np.concatenate(halves, axis=-1)
        yield "streams/tcp_pose", streams["tcp_pose"], pose(read, "/tcp_pose|pose")
        for k, stored in enumerate(np.moveaxis(streams["object_pose"], 1, 0)):
            yield "streams/object_pose", stored, pose(read, f"/object_poses|poses.{k}")
        yield "streams/hand_force", streams["hand_force"], parts(read, "/hand_force|vector", XYZ)
        for name in PLAIN:
            yield f"streams/{name}", streams[name], read[f"/streams/{name}|data"]
            check_layout(read, f"/streams/{name}", streams[name].shape[1:])
    if episode.n_imu:
        for name, field in IMU.items():
            yield f"imu/{name}", imu[name], parts(read, f"/imu/data|{field}", XYZ)
        yield "imu/timestamp", imu["timestamp"], read["/imu/timestamp|data"]
    yield "imu/T_tcp_imu", imu["T_tcp_imu"], read["/imu/T_tcp_imu|data"]
    yield from compared_cameras(episode, read)
    if has_video(episode):
        stored = episode.videos["timestamp"]
        yield "videos/timestamp", stored, read["/videos/timestamp|data"]


def has_video(episode: Episode) -> bool:
    return len(episode.videos.get("timestamp", ())) > 0


def compared_cameras(episode: Episode, read: Read) -> Compared:
    names = json.loads(str(read["/episode|data"][0]))["cameras"]
    assert sorted(names.values()) == sorted(episode.cameras)
    for topic, camera in names.items():
        frames, base, path = episode.cameras[camera], f"/cameras/{topic}", f"cameras/{camera}"
        yield f"{path}/rgb", frames.rgb, images(read, f"{base}/color/image_raw", "rgb8")
        yield f"{path}/depth", frames.depth, images(read, f"{base}/depth/image_raw", "32FC1")
        labels = images(read, f"{base}/segmentation", "8UC1")
        yield f"{path}/segmentation", frames.segmentation, labels
        for info in ("color", "depth"):
            K = read[f"{base}/{info}/camera_info|k"]
            yield f"{path}/intrinsics", frames.intrinsics, K[0]
            yield f"{path}/intrinsics", frames.intrinsics, K[1]
        for name in ("T_world_camera", "visibility"):
            yield f"{path}/{name}", getattr(frames, name), read[f"{base}/{name}|data"]
        if has_video(episode):
            video, path = f"{base}/video", f"videos/{camera}"
            stored = episode.videos[f"{camera}/rgb"]
            yield f"{path}/rgb", stored, images(read, f"{video}/image_raw", "rgb8")
            poses = episode.videos[f"{camera}/T_world_camera"]
            yield f"{path}/T_world_camera", poses, read[f"{video}/T_world_camera|data"]


def images(read: Read, topic: str, encoding: str) -> NDArray[Any]:
    assert set(read[f"{topic}|encoding"]) == {encoding}
    assert not read[f"{topic}|is_bigendian"].any()
    data = read[f"{topic}|data"].astype(np.uint8)
    height, width, step = (int(read[f"{topic}|{name}"][0]) for name in ("height", "width", "step"))
    kind = np.dtype(np.float32) if encoding == "32FC1" else np.dtype(np.uint8)
    channels = 3 if encoding == "rgb8" else 1
    assert step == width * channels * kind.itemsize
    return np.ascontiguousarray(data).view(kind).reshape(len(data), height, width, channels)


def parts(read: Read, name: str, letters: tuple[str, ...]) -> Array:
    return np.stack([read[f"{name}.{letter}"] for letter in letters], axis=-1)


def pose(read: Read, name: str) -> Array:
    both = [parts(read, f"{name}.position", XYZ), parts(read, f"{name}.orientation", XYZW)]
    return np.concatenate(both, axis=-1)


def check_layout(read: Read, topic: str, shape: tuple[int, ...]) -> None:
    for k, size in enumerate(shape):
        assert set(read[f"{topic}|layout.dim.{k}.size"]) == {size}
        assert set(read[f"{topic}|layout.dim.{k}.stride"]) == {int(np.prod(shape[k:]))}
        assert all(read[f"{topic}|layout.dim.{k}.label"])


def check_stamps(episode: Episode, read: Read) -> None:
    """Check that stamps are 1 s plus the time of the store, and that messages are sent then.

    Without transforms, theirs are not checked.
    """
    times = {
        "/joint_states": episode.streams["timestamp"],
        "/tf|transforms.0": episode.streams["timestamp"],
        "/imu/data": episode.imu["timestamp"],
    }
    for name, seconds in times.items():
        if len(seconds) and f"{name.partition('|')[0]}|sent_ns" in read:
            key = f"{name}." if "|" in name else f"{name}|"
            stamp = read[f"{key}header.stamp.sec"].astype(np.int64) * 10**9
            stamp = stamp + read[f"{key}header.stamp.nanosec"]
            np.testing.assert_array_equal(stamp, np.rint(seconds * 1e9).astype(int) + START_NS)
            np.testing.assert_array_equal(stamp, read[f"{name.partition('|')[0]}|sent_ns"])
    for key in read:
        if key.endswith("image_raw|sent_ns") and "/video/" not in key:
            end = int(np.rint(max(episode.streams["timestamp"], default=0.0) * 1e9))
            assert read[key].tolist() == [START_NS, START_NS + end]


def check_transforms(episode: Episode, read: Read) -> None:
    """Check that tf leads to the cameras' poses of the store."""
    frames = read_frames(read, "/tf_static")
    names = json.loads(str(read["/episode|data"][0]))["cameras"]
    for topic, camera in names.items():
        parent, T = frames[topic]
        if parent == "world":
            np.testing.assert_allclose(T[0], episode.cameras[camera].T_world_camera[0], atol=1e-9)
        elif episode.n_steps:
            parent, hand = read_frames(read, "/tf")[parent]
            assert parent == "world"
            T_world_camera = hand[-1] @ T[0]
            stored = episode.cameras[camera].T_world_camera[1]
            np.testing.assert_allclose(T_world_camera, stored, atol=5e-3)  # a record apart
    for name in ("imu", "ft_sensor"):
        np.testing.assert_allclose(frames[name][1][0], episode.imu["T_tcp_imu"], atol=1e-9)


def read_frames(read: Read, topic: str) -> dict[str, tuple[str, Array]]:
    """Return parent and poses (n, 4, 4) of each frame."""
    found = {}
    ends = [key for key in read if key.startswith(f"{topic}|") and key.endswith(".child_frame_id")]
    for end in ends:
        base = end.removesuffix(".child_frame_id")
        translation = parts(read, f"{base}.transform.translation", XYZ)
        rotation = parts(read, f"{base}.transform.rotation", XYZW)
        T = pose_matrices(np.concatenate([translation, rotation], axis=-1))
        found[str(read[end][0])] = (str(read[f"{base}.header.frame_id"][0]), T)
    return found


def equal_columns(episode: Episode, columns: Mapping[str, Any]) -> int:
    """Compare the columns that are numbers, and the words; return the number of values."""
    seen = 0
    for path, stored in episode.contents().items():
        name = path.removeprefix("episodes/")
        if path == name or name in ("spec", "outcome", "collision_body"):
            continue
        kind = stored.dtype if stored.dtype.kind != "U" else None
        found = np.array(columns[name], kind)  # None becomes NaN
        np.testing.assert_array_equal(found, stored, err_msg=path)
        seen += stored.size
    assert columns["outcome"] == episode.outcome.name.lower()
    return seen
