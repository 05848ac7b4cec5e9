"""What the cameras of an episode saw as messages, on topics below ``/cameras/NAME``."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from grasp_factory.core.episode import CameraFrames
from grasp_factory.core.geometry import Array
from grasp_factory.writers.exporters.rosbag.array_topics import array_messages
from grasp_factory.writers.exporters.rosbag.topics import (
    START_NS,
    BagScene,
    StampedMessage,
    Topic,
    end_stamp,
    stamps,
)

ENCODINGS = {("uint8", 4): "rgb8", ("float32", 3): "32FC1", ("uint8", 3): "8UC1"}
"""Encodings of sensor_msgs/Image by type and number of dimensions of images.

Depth is in metres: https://www.ros.org/reps/rep-0118.html
"""


def camera_messages(scene: BagScene, camera: str) -> list[Iterator[StampedMessage]]:
    """Return the messages of each topic of a camera's images before and after the attempt."""
    frames = scene.episode.cameras[camera]
    base, frame = f"/cameras/{scene.cameras[camera]}", scene.cameras[camera]
    times = [START_NS, end_stamp(scene.episode)]
    path = f"cameras/{camera}"
    return [
        image_messages(scene, f"{base}/color/image_raw", frame, times, frames.rgb),
        image_messages(scene, f"{base}/depth/image_raw", frame, times, frames.depth),
        image_messages(scene, f"{base}/segmentation", frame, times, frames.segmentation),
        info_messages(scene, f"{base}/color/camera_info", frame, times, frames),
        info_messages(scene, f"{base}/depth/camera_info", frame, times, frames),
        *(
            array_messages(scene, f"{path}/{name}", f"{base}/{name}", times, getattr(frames, name))
            for name in ("T_world_camera", "visibility")
        ),
    ]


def video_messages(scene: BagScene) -> list[Iterator[StampedMessage]]:
    """Return the messages of each topic of the videos; nothing without video."""
    arrays = scene.episode.videos
    if not arrays:
        return []
    times = stamps(arrays["timestamp"])
    found = [
        array_messages(scene, "videos/timestamp", "/videos/timestamp", times, arrays["timestamp"])
    ]
    for camera, frames in scene.episode.cameras.items():
        frame = scene.cameras[camera]
        base, path = f"/cameras/{frame}/video", f"videos/{camera}/T_world_camera"
        images, poses = (arrays[f"{camera}/{name}"] for name in ("rgb", "T_world_camera"))
        found += [
            image_messages(scene, f"{base}/image_raw", frame, times, images),
            info_messages(scene, f"{base}/camera_info", frame, times, frames),
            array_messages(scene, path, f"{base}/T_world_camera", times, poses),
        ]
    return found


def image_messages(
    scene: BagScene, name: str, frame: str, times: Sequence[int], images: NDArray[Any]
) -> Iterator[StampedMessage]:
    """Yield images (n, H, W) or (n, H, W, 3) as messages."""
    topic = Topic(name=name, kind="sensor_msgs/msg/Image")
    height, width = images.shape[1:3]
    for stamp, image in zip(times, images, strict=True):
        message = scene.make(
            topic.kind,
            header=scene.make.header(stamp, frame),
            height=height,
            width=width,
            encoding=ENCODINGS[images.dtype.name, images.ndim],
            step=image.nbytes // height,
            data=np.ascontiguousarray(image).reshape(-1).view(np.uint8),
        )
        yield StampedMessage(stamp, topic, message)


def info_messages(
    scene: BagScene, name: str, frame: str, times: Sequence[int], frames: CameraFrames
) -> Iterator[StampedMessage]:
    """Yield the calibration of an image without distortion."""
    topic = Topic(name=name, kind="sensor_msgs/msg/CameraInfo")
    height, width = frames.depth.shape[1:]
    K: Array = frames.intrinsics
    for stamp in times:
        message = scene.make(
            topic.kind,
            header=scene.make.header(stamp, frame),
            height=height,
            width=width,
            distortion_model="plumb_bob",
            d=np.zeros(5),
            k=K.ravel(),
            r=np.eye(3).ravel(),
            p=np.hstack([K, np.zeros((3, 1))]).ravel(),
        )
        yield StampedMessage(stamp, topic, message)
