"""The tensor data set of GQ-CNN (Dex-Net): crops of depth images around grasps, and a metric.

``config.json``, ``tensors/<field>_<number>.npz`` with the key arr_0, and ``splits/object_wise/``.
Layout: https://github.com/BerkeleyAutomation/autolab_core, autolab_core/tensor_dataset.py; fields:
https://github.com/BerkeleyAutomation/gqcnn, cfg/train.yaml; crops and poses:
https://github.com/BerkeleyAutomation/dex-net, tools/generate_gqcnn_dataset.py
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from grasp_factory.core.episode import CameraFrames
from grasp_factory.core.serialization import check_range
from grasp_factory.writers.exporters.base import (
    REAL_ROWS,
    REAL_SERIES,
    ExportContents,
    Exporter,
    ExportJob,
    ExportPart,
    episodes_of_each_file,
    parts_of,
)
from grasp_factory.writers.exporters.grasp_rectangle import GraspRectangle
from grasp_factory.writers.exporters.json_file import write_json
from grasp_factory.writers.exporters.overhead_view import (
    overhead_camera,
    rectangle_in,
    without_grasp,
)
from grasp_factory.writers.exporters.selection import Selection

IMAGES, POSES, METRICS = "tf_depth_ims", "grasps", "grasp_metrics"
POSE_VALUES = 7
"""Row and column (pixels), depth (m), angle (rad), row and column from the image's centre, width
(pixels): ``hand_pose`` of generate_gqcnn_dataset.py."""
SPLIT = "object_wise"
"""Name of the split by the store's train and val; GQ-CNN's option --split_name chooses it."""


@dataclass(frozen=True, slots=True, kw_only=True)
class GqcnnSettings:
    """Settings of the format."""

    camera: str = ""
    """The camera whose depth is cropped; empty for ``overhead``, which must then be there."""
    size: int = 32
    """Pixels of each side of a crop; GQ-CNN 2.0 takes 32, and 4.0 takes 96."""
    extent: float = 0.168
    """Side of a crop at the grasp's depth, metres; the iiwa's open gripper is 142 mm long."""
    episodes_per_shard: int = 0
    """Grasps in a file; 0 for an eighth of all, 8 to 64. One file of each field is in memory at a
    time."""

    def __post_init__(self) -> None:
        check_range(self, "size", 8, 128, "pixels")
        check_range(self, "extent", 0.01, 1.0, "m")
        check_range(self, "episodes_per_shard", 0, 4096)


def excludes(episodes: Selection, settings: GqcnnSettings) -> Mapping[str, NDArray[np.bool_]]:
    """Exclude episodes without a grasp, and those whose camera was not calibrated.

    Raises:
        UnknownNameError: for an unknown camera.
        UsageError: if no camera is named and there is no ``overhead``.
    """
    camera = overhead_camera(episodes, settings.camera)
    return without_grasp(episodes, [camera])


def split(episodes: Selection, settings: GqcnnSettings) -> list[range]:
    """Return the episodes of each file: all files but the last must have the same number."""
    return parts_of(len(episodes), _grasps_per_file(episodes, settings))


def _grasps_per_file(episodes: Selection, settings: GqcnnSettings) -> int:
    return episodes_of_each_file(len(episodes), settings.episodes_per_shard)


def write_part(job: ExportJob, part: ExportPart) -> None:
    """Write a file of each field."""
    settings: GqcnnSettings = job.settings
    camera = overhead_camera(job.episodes, settings.camera)
    tensors = tuple(np.zeros(shape, np.float32) for shape in shapes(len(part.places), settings))
    images, poses, metrics = tensors
    for k, (_, episode) in enumerate(part.episodes):
        frames = episode.cameras[camera]
        grasp = rectangle_in(episode, frames.intrinsics, frames.T_world_camera[0])
        metrics[k] = episode.success
        if grasp:
            images[k, :, :, 0] = grasp_image(frames, grasp, settings)
            poses[k] = pose_values(frames, grasp)
    folder = job.folder / "tensors"
    folder.mkdir(exist_ok=True)
    for name, values in zip((IMAGES, POSES, METRICS), tensors, strict=True):
        np.savez_compressed(folder / f"{name}_{part.number:05d}.npz", values)


def shapes(count: int, settings: GqcnnSettings) -> tuple[tuple[int, ...], ...]:
    """Return the shapes of images, poses and metrics of some grasps."""
    return (count, settings.size, settings.size, 1), (count, POSE_VALUES), (count,)


def pose_values(frames: CameraFrames, grasp: GraspRectangle) -> list[float]:
    """Return a grasp as GQ-CNN lists it; see ``POSE_VALUES``."""
    (_, _, cx), (_, _, cy), _ = frames.intrinsics.tolist()
    place = [grasp.y, grasp.x, grasp.depth, grasp.angle]
    return [*place, grasp.y - cy, grasp.x - cx, grasp.opening]


def grasp_image(
    frames: CameraFrames, grasp: GraspRectangle, settings: GqcnnSettings
) -> NDArray[np.float32]:
    """Return the depth (S, S), metres, around a grasp before the attempt.

    The grasp is in the middle, and its closing direction follows the rows from left to right. Each
    pixel has the depth of the nearest one; pixels without depth or outside the image are 0.
    """
    middles = ((np.arange(settings.size) + 0.5) / settings.size - 0.5) * settings.extent
    across, down = middles / grasp.depth, middles[:, None] / grasp.depth
    sine, cosine = math.sin(grasp.angle), math.cos(grasp.angle)
    K, depth = frames.intrinsics, frames.depth[0]
    column = np.rint(grasp.x + (cosine * across - sine * down) * K[0, 0])
    row = np.rint(grasp.y + (sine * across + cosine * down) * K[1, 1])
    height, width = depth.shape
    inside = (row >= 0) & (row < height) & (column >= 0) & (column < width)
    nearest = np.where(inside, row * width + column, 0).astype(np.intp)
    image = depth.reshape(-1).take(nearest)
    return np.where(inside & np.isfinite(image), image, np.float32(0.0))


def finish(job: ExportJob, parts: Sequence[None]) -> None:
    """Write config.json and the split by objects."""
    settings: GqcnnSettings = job.settings
    side = {"height": settings.size, "width": settings.size, "channels": 1}
    config = {
        "datapoints_per_file": _grasps_per_file(job.episodes, settings),
        "fields": {
            IMAGES: {"dtype": "float32", **side},
            POSES: {"dtype": "float32", "height": POSE_VALUES},
            METRICS: {"dtype": "float32"},
        },
    }
    write_json(job.folder / "config.json", config)
    folder = job.folder / "splits" / SPLIT
    folder.mkdir(parents=True)
    splits = job.episodes.column("split")
    for name in ("train", "val"):
        np.savez_compressed(folder / f"{name}_indices.npz", np.flatnonzero(splits == name))
    write_json(folder / "metadata.json", {"what": "train and val of the store: other objects"})


GQCNN = Exporter(
    name="gqcnn",
    description="crops of depth images around grasps, for GQ-CNN of Dex-Net",
    contents=ExportContents(
        written=("cameras/*/depth",),
        left_out={
            "cameras/*": "the network sees depth only, in pixels around the grasp",
            "streams/*": "the layout has no time series",
            **dict.fromkeys(("imu/*", *REAL_SERIES), "the layout has no time series"),
            "videos/*": "the layout has no videos",
        },
        treatment={
            "images": "of one camera before the attempt: what is around the grasp, turned so that"
            " the gripper closes along the rows; each pixel has the depth of the nearest one",
            "missing depth": "0; so is what lies beyond the image",
            "metric": "1 for a success, else 0: a threshold of 0.5 separates them",
            "tilted grasps": "written as their projection: GQ-CNN takes every grasp as one along"
            " the camera's axis",
            "grasp behind the camera": "its image and its pose are 0",
            "split": f"{SPLIT} has train and val of the store; test is in neither",
            "no grasp": "the episode is left out",
            REAL_ROWS: "left out if the grasp's pose was not measured, or the camera not"
            " calibrated",
        },
    ),
    excludes=excludes,
    split=split,
    write_part=write_part,
    series=(),
    finish=finish,
    parameters=GqcnnSettings,
)
