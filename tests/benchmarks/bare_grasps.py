"""Bare loops of the exports for networks that predict grasps: see ``bare_exports.py``."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from grasp_factory.core.enums import Label
from grasp_factory.core.episode import CameraFrames, Episode
from grasp_factory.core.geometry import inverse
from grasp_factory.dataset.dataset import Dataset
from grasp_factory.signals.tsdf import DepthView, tsdf_grid
from grasp_factory.writers.exporters.images import PNG_LEVEL

LEVEL = [cv2.IMWRITE_PNG_COMPRESSION, PNG_LEVEL]
DEFLATE = [cv2.IMWRITE_TIFF_COMPRESSION, 8, cv2.IMWRITE_TIFF_PREDICTOR, 1]
CUBE, VOXELS = 0.3, 40
"""Side of VGN's cube, m, and voxels along an edge."""


def cornell(dataset: Dataset, out: Path) -> None:
    """Write images of 640 x 480 by OpenCV, with a text file of corners."""
    write_images_from_above(dataset, out, (640, 480))


def jacquard(dataset: Dataset, out: Path) -> None:
    """Write images of 1024 x 1024 by OpenCV, with a text file of rectangles."""
    write_images_from_above(dataset, out, (1024, 1024))


def write_images_from_above(dataset: Dataset, out: Path, size: tuple[int, int]) -> None:
    for i, episode, frames in with_grasps(dataset):
        folder = out / str(episode.columns["object_id"])
        folder.mkdir(parents=True, exist_ok=True)
        mask = np.uint8(255) * (frames.segmentation[0] >= Label.TARGET)
        names = ("rgb.png", frames.rgb[0][..., ::-1]), ("mask.png", mask)
        for name, image in names:
            cv2.imwrite(str(folder / f"{i}_{name}"), resized(image, size), LEVEL)
        cv2.imwrite(str(folder / f"{i}_depth.tiff"), resized(frames.depth[0], size), DEFLATE)
        (folder / f"{i}_grasps.txt").write_text(f"{pixel(episode, frames)} {episode.success}\n")


def gqcnn(dataset: Dataset, out: Path) -> None:
    """Write crops of depth that OpenCV turns, compressed by NumPy, in files of 256."""
    out.mkdir()
    crops, poses, labels = [], [], []
    for i, episode, frames in with_grasps(dataset):
        column, row = pixel(episode, frames)
        turn = cv2.getRotationMatrix2D((column, row), 0.0, 0.5)
        turn[:, 2] += (16.0 - column, 16.0 - row)
        crops.append(cv2.warpAffine(frames.depth[0], turn, (32, 32), flags=cv2.INTER_NEAREST))
        poses.append([row, column, 0.6, 0.0, 0.0, 0.0, 30.0])
        labels.append(float(episode.success))
        if len(crops) == 256:
            write_tensors(out, i, crops, poses, labels)
            crops, poses, labels = [], [], []
    write_tensors(out, len(dataset), crops, poses, labels)


def write_tensors(out: Path, number: int, *lists: list[Any]) -> None:
    for k, values in enumerate(lists):
        np.savez_compressed(out / f"{k}_{number}.npz", np.array(values, np.float32))


def vgn(dataset: Dataset, out: Path) -> None:
    """Write depth images and their TSDF, compressed by NumPy."""
    out.mkdir()
    for i, episode, _ in with_grasps(dataset):
        T_world_cube = np.eye(4)
        T_world_cube[:3, 3] = episode.columns["grasp_position"] - CUBE / 2.0
        views = [
            DepthView(
                depth=frames.depth[0],
                K=frames.intrinsics,
                T_camera_cube=inverse(frames.T_world_camera[0]) @ T_world_cube,
            )
            for frames in episode.cameras.values()
        ]
        images = np.stack([view.depth for view in views])
        poses = np.stack([view.T_camera_cube for view in views])
        np.savez_compressed(out / f"raw_{i}.npz", depth_imgs=images, extrinsics=poses)
        np.savez_compressed(out / f"{i}.npz", grid=tsdf_grid(views, CUBE, VOXELS))


def with_grasps(dataset: Dataset) -> Iterator[tuple[int, Episode, CameraFrames]]:
    """Yield number, episode and images from above of each episode with a grasp."""
    for i, episode in enumerate(dataset):
        if np.isfinite(episode.columns["grasp_position"]).all():
            yield i, episode, episode.cameras["overhead"]


def resized(image: NDArray[Any], size: tuple[int, int]) -> NDArray[Any]:
    return cv2.resize(image, size, interpolation=cv2.INTER_NEAREST)


def pixel(episode: Episode, frames: CameraFrames) -> tuple[float, float]:
    """Return column and row of the TCP."""
    point = inverse(frames.T_world_camera[0]) @ [*episode.columns["grasp_position"], 1.0]
    seen = frames.intrinsics @ (point[:3] / point[2])
    return float(seen[0]), float(seen[1])
