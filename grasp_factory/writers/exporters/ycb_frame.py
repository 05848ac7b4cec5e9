"""The files of a YCB-Video frame: ``-color.png``, ``-depth.png``, ``-label.png``, boxes and poses.

Keys of the MATLAB file: https://github.com/yuxng/YCB_Video_toolbox, README.
"""

from __future__ import annotations

import io
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from grasp_factory.core.camera import project
from grasp_factory.core.episode import CameraFrames, Episode
from grasp_factory.core.geometry import Array, inverse
from grasp_factory.writers.exporters.images import depth_to_uint16, write_png
from grasp_factory.writers.exporters.object_views import ObjectView, box_of, object_views

FACTOR_DEPTH = 10_000
"""Units of the depth images in a metre."""
HEADER = b"MATLAB 5.0 MAT-file, written by grasp-factory".ljust(116)
"""Text at the start of a MATLAB file; SciPy's contains the time, so bytes would not repeat."""


def write_frame(
    stem: Path,
    episode: Episode,
    frames: CameraFrames,
    k: int,
    class_of: Callable[[ObjectView], tuple[int, str]],
) -> int:
    """Write the files of a frame.

    Args:
        stem: start of the files' paths.
        episode: the episode.
        frames: the images of a camera.
        k: 0 before the attempt, 1 after it.
        class_of: returns the number, from 1, and the name of an object's class.

    Returns:
        The largest number of pixels with depth that an object has.
    """
    views = [(view, *class_of(view)) for view in object_views(episode, frames, k)]
    depth = depth_to_uint16(frames.depth[k], 1.0 / FACTOR_DEPTH)
    label = np.zeros(depth.shape, np.uint8)
    boxes = []
    for view, number, name in views:
        label[view.mask] = number
        if view.mask.any():
            x, y, width, height = box_of(view.mask)
            boxes.append(f"{name} {x} {y} {x + width - 1} {y + height - 1}\n")
    write_png(_named(stem, "color.png"), frames.rgb[k])
    write_png(_named(stem, "depth.png"), depth)
    write_png(_named(stem, "label.png"), label)
    _named(stem, "box.txt").write_text("".join(boxes), encoding="ascii")
    numbers = np.array([number for _, number, _ in views], np.uint8)
    content = meta(frames, k, [view.T_camera_object for view, _, _ in views], numbers)
    _named(stem, "meta.mat").write_bytes(matlab_file(content))
    return max((int(np.count_nonzero(view.mask & (depth > 0))) for view, _, _ in views), default=0)


def meta(
    frames: CameraFrames, k: int, poses: list[Array], numbers: NDArray[np.uint8]
) -> dict[str, Any]:
    """Return the content of a frame's MATLAB file for the poses (4, 4) of N objects, metres."""
    T_camera_object = np.array(poses).reshape(-1, 4, 4)
    with np.errstate(divide="ignore", invalid="ignore"):
        centers = project(T_camera_object[:, :3, 3], frames.intrinsics)
    return {
        "center": centers,
        "cls_indexes": numbers[:, None],
        "factor_depth": np.array([[FACTOR_DEPTH]], np.uint16),
        "intrinsic_matrix": frames.intrinsics,
        "poses": np.moveaxis(T_camera_object[:, :3], 0, -1),
        "rotation_translation_matrix": inverse(frames.T_world_camera[k])[:3],
    }


def matlab_file(content: dict[str, Any]) -> bytes:
    """Return arrays by name as the bytes of a MATLAB file."""
    from scipy.io import savemat  # noqa: PLC0415

    data = io.BytesIO()
    savemat(data, content)
    return HEADER + data.getvalue()[len(HEADER) :]


def _named(stem: Path, suffix: str) -> Path:
    return stem.with_name(f"{stem.name}-{suffix}")
