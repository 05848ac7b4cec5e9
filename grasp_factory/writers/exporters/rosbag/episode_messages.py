"""All messages of an episode in the order of their stamps."""

from __future__ import annotations

import heapq
import json
from collections.abc import Iterator
from operator import itemgetter

import numpy as np

from grasp_factory.core.config.cameras import Mount
from grasp_factory.core.geometry import Array, Pose, look_at
from grasp_factory.core.palette import OUTCOMES, rgb
from grasp_factory.writers.exporters.plain_columns import plain_columns
from grasp_factory.writers.exporters.rosbag.camera_topics import camera_messages, video_messages
from grasp_factory.writers.exporters.rosbag.series_topics import series_messages
from grasp_factory.writers.exporters.rosbag.topics import START_NS, BagScene, StampedMessage, Topic

_TEXT, _TEXT_HEIGHT_M = 9, 0.04
"""Type of a marker that is text, and the height of its letters; see visualization_msgs/Marker."""


def episode_messages(scene: BagScene) -> Iterator[StampedMessage]:
    """Yield the messages; those of the same instant come in the order of the topics."""
    sources = [iter([episode_text(scene), label_marker(scene), static_transforms(scene)])]
    for camera in scene.episode.cameras:
        sources += camera_messages(scene, camera)
    for group in scene.episode.series:
        sources += video_messages(scene) if group == "videos" else series_messages(scene, group)
    return heapq.merge(*sources, key=itemgetter(0))


def episode_text(scene: BagScene) -> StampedMessage:
    """Return the columns as JSON, and under ``cameras`` the cameras' names by that in topics."""
    columns = plain_columns(scene.episode.spec, scene.episode.contents())
    columns["cameras"] = {topic: camera for camera, topic in scene.cameras.items()}
    topic = Topic(name="/episode", kind="std_msgs/msg/String", is_latched=True)
    text = json.dumps(columns, allow_nan=False)
    return StampedMessage(START_NS, topic, scene.make(topic.kind, data=text))


def label_marker(scene: BagScene) -> StampedMessage:
    """Return the outcome as text at the grasp, else where the target lay, else at the origin."""
    topic = Topic(name="/label", kind="visualization_msgs/msg/Marker", is_latched=True)
    episode, make = scene.episode, scene.make
    grasp = np.asarray(episode.columns["grasp_position"], np.float64)
    place = grasp if np.isfinite(grasp).all() else episode.columns["object_rest_pose"][0, :3]
    place = np.zeros(3) if episode.is_real and np.isnan(place).any() else np.asarray(place)
    red, green, blue = (part / 255.0 for part in rgb(OUTCOMES[str(episode.outcome)].dark))
    marker = make(
        topic.kind,
        header=make.header(START_NS, "world"),
        ns="label",
        type=_TEXT,
        pose=make.pose([*place.tolist(), 0.0, 0.0, 0.0, 1.0]),
        scale=make.vector([0.0, 0.0, _TEXT_HEIGHT_M]),
        color=make("std_msgs/msg/ColorRGBA", r=red, g=green, b=blue, a=1.0),
        text=f"{episode.outcome.name.lower()}: {episode.columns['object_id']}",
    )
    return StampedMessage(START_NS, topic, marker)


def static_transforms(scene: BagScene) -> StampedMessage:
    """Return the frames that do not move: cameras, and what is fixed to the hand."""
    topic = Topic(name="/tf_static", kind="tf2_msgs/msg/TFMessage", is_latched=True)
    episode = scene.episode
    frames = [("tcp", name, episode.imu["T_tcp_imu"]) for name in ("imu", "ft_sensor")]
    for camera, config in episode.spec.cameras.items():
        if config.mount is Mount.TCP:
            T_tcp_camera = look_at(config.eye, config.target, config.up)
            frames.append(("tcp", scene.cameras[camera], T_tcp_camera))
        else:
            T_world_camera = episode.cameras[camera].T_world_camera[0]
            frames.append(("world", scene.cameras[camera], T_world_camera))
    transforms = [
        scene.make.transform(START_NS, parent, child, _pose(T))
        for parent, child, T in frames
        if np.isfinite(T).all() or not episode.is_real
    ]
    return StampedMessage(START_NS, topic, scene.make(topic.kind, transforms=transforms))


def _pose(T: Array) -> list[float]:
    pose = Pose.from_matrix(T)
    return [*pose.position, *pose.quat_xyzw]
