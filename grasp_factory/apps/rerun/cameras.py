"""Logging what the cameras saw: images under a pinhole, and the point clouds of all cameras."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np
import rerun as rr
from numpy.typing import NDArray

from grasp_factory.apps.pictures.painting import depth_span, label_palette
from grasp_factory.apps.rerun.clock import poses, seconds
from grasp_factory.core.config.cameras import Mount
from grasp_factory.core.enums import label_names
from grasp_factory.core.episode import CameraFrames, Episode
from grasp_factory.core.geometry import Array, Pose, look_at, pose_matrices
from grasp_factory.core.palette import DEPTH_MAP
from grasp_factory.signals.point_cloud import PointCloud

CAMERAS = "world/cameras"
CLOUD = "world/cloud"
MOST_POINTS = 100_000
"""Maximum points of a cloud; the depth images contain the others."""
IMAGE_PLANE_M = 0.15
"""Distance in front of a camera at which its image is shown."""
PNG = "image/png"


def log_labels(recording: rr.RecordingStream, objects: int) -> None:
    """Log name and colour of each label of the segmentation."""
    colors = label_palette()[:, ::-1].tolist()
    context = [(i, word, colors[i]) for i, word in enumerate(label_names(objects))]
    recording.log("world", rr.AnnotationContext(context), static=True)


def log_cameras(recording: rr.RecordingStream, episode: Episode, times: Sequence[float]) -> None:
    """Log the videos, the images before the attempt and, if the arm moved, those after it.

    Args:
        recording: The recording to log to.
        episode: The episode of the images.
        times: Times of the images, s: one or two.
    """
    for name, frames in episode.cameras.items():
        entity = f"{CAMERAS}/{name}"
        height, width = frames.depth.shape[1:]
        if is_calibrated(frames):
            pinhole = rr.Pinhole(
                image_from_camera=frames.intrinsics,
                resolution=[width, height],
                camera_xyz=rr.ViewCoordinates.RDF,
                image_plane_distance=IMAGE_PLANE_M,
            )
            recording.log(entity, pinhole, static=True)
            recording.send_columns(entity, *_camera_motion(episode, name, frames, times))
        _log_images(recording, entity, frames, times, episode.spec.cameras[name].far)
        _log_rgb(recording, entity, *_pictures(episode, name, frames, times))


def is_calibrated(frames: CameraFrames) -> bool:
    """Return whether a camera's intrinsics and poses are known."""
    values = (frames.intrinsics, frames.T_world_camera)
    return all(bool(np.isfinite(each).all()) for each in values)


def log_clouds(
    recording: rr.RecordingStream, clouds: Sequence[PointCloud], times: Sequence[float]
) -> None:
    """Log the point clouds of all cameras together, in their colours, at some times (s)."""
    for cloud, time in zip(clouds, times, strict=True):
        step = max(1, -(-len(cloud) // MOST_POINTS))
        recording.send_columns(
            CLOUD,
            [seconds([time])],
            rr.Points3D.columns(positions=cloud.points[::step], colors=cloud.rgb[::step]).partition(
                [len(cloud.points[::step])]
            ),
        )


def _camera_motion(
    episode: Episode, name: str, frames: CameraFrames, times: Sequence[float]
) -> tuple[list[rr.TimeColumn], rr.ComponentColumnList]:
    """Return a camera's poses over time as columns; a camera on the hand moves with the records."""
    config, stamps = episode.spec.cameras[name], np.array(times)
    places = frames.T_world_camera[: len(times)]
    if config.mount is Mount.TCP and episode.n_steps:
        T_tcp_camera = look_at(config.eye, config.target, config.up)
        hand = pose_matrices(episode.streams["tcp_pose"]) @ T_tcp_camera
        stamps = np.concatenate([stamps[:1], episode.streams["timestamp"]])
        places = np.concatenate([places[:1], hand])
    return [seconds(stamps)], poses(_poses(places))


def _poses(T: Array) -> Array:
    """Return poses (n, 7) of transforms (n, 4, 4)."""
    found = (Pose.from_matrix(each) for each in T)
    return np.array([(*pose.position, *pose.quat_xyzw) for pose in found])


def _log_images(
    recording: rr.RecordingStream,
    entity: str,
    frames: CameraFrames,
    times: Sequence[float],
    far: float,
) -> None:
    colors = rr.components.Colormap.auto(DEPTH_MAP)
    span = depth_span(frames.depth[0], frames.segmentation[0], far)
    for i, time in enumerate(times):
        recording.set_time("time", duration=time)
        depth = rr.DepthImage(frames.depth[i], meter=1.0, colormap=colors, depth_range=span)
        recording.log(f"{entity}/depth", depth)
        recording.log(f"{entity}/segmentation", rr.SegmentationImage(frames.segmentation[i]))
    recording.reset_time()


def _pictures(
    episode: Episode, name: str, frames: CameraFrames, times: Sequence[float]
) -> tuple[list[float], list[NDArray[np.uint8]]]:
    """Return times (s) and RGB images of a camera in order, including those of its video."""
    stamps, images = list(times), list(frames.rgb[: len(times)])
    if episode.videos:
        stamps[1:1] = episode.videos["timestamp"].tolist()
        images[1:1] = list(episode.videos[f"{name}/rgb"])
    return stamps, images


def _log_rgb(
    recording: rr.RecordingStream,
    entity: str,
    times: Sequence[float],
    images: Sequence[NDArray[np.uint8]],
) -> None:
    """Log images without loss, as PNG, which takes a tenth of their size."""
    files = []
    for image in images:
        ok, data = cv2.imencode(".png", image[..., ::-1])
        assert ok
        files.append(data.tobytes())
    columns = rr.EncodedImage.columns(blob=files, media_type=[PNG] * len(files))
    recording.send_columns(f"{entity}/rgb", [seconds(times)], columns)
