"""A scene of BOP: an episode's images with their poses, boxes and visible masks.

Keys and units: ``bop_datasets_format`` in https://github.com/thodan/bop_toolkit/tree/master/docs
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from grasp_factory.core.camera import project
from grasp_factory.core.episode import CameraFrames, Episode
from grasp_factory.core.geometry import Array, apply, inverse
from grasp_factory.core.triangle_mesh import TriangleMesh
from grasp_factory.writers.exporters.images import depth_to_uint16, write_png
from grasp_factory.writers.exporters.json_items import member, write_items
from grasp_factory.writers.exporters.object_models import ModelKey, ModelNumbers, key_of
from grasp_factory.writers.exporters.object_views import TIMES, ObjectView, box_of, object_views
from grasp_factory.writers.exporters.silhouette import silhouette

MM = 1000.0
"""Millimetres in a metre."""
DEPTH_SCALE = 0.1
"""Millimetres of a unit of the depth images, which reach 6.5535 m."""
NO_BOX = [-1, -1, -1, -1]
"""Box of what is not in the image."""
_FARTHEST = 1e6
"""Pixels from the image's corner at which a point counts as behind the camera."""

Info = dict[str, Any]


@dataclass(frozen=True, slots=True, kw_only=True)
class SceneModels:
    """What a scene needs to know of its objects."""

    numbers: ModelNumbers
    meshes: Mapping[ModelKey, TriangleMesh]


def write_scene(
    folder: Path, episode: Episode, models: SceneModels
) -> dict[int, list[tuple[int, Info]]]:
    """Write the files of a scene.

    Returns:
        For each image the model's number and the entry in ``scene_gt_info.json`` of each object.
    """
    for name in ("rgb", "depth", "mask_visib"):
        (folder / name).mkdir(parents=True)
    cameras: dict[int, Any] = {}
    poses: dict[int, list[Any]] = {}
    infos: dict[int, list[Info]] = {}
    for c, (name, frames) in enumerate(episode.cameras.items()):
        for k, time in enumerate(TIMES):
            image = c * len(TIMES) + k
            views = object_views(episode, frames, k)
            depth = depth_to_uint16(frames.depth[k], DEPTH_SCALE / MM)
            write_png(folder / "rgb" / f"{image:06d}.png", frames.rgb[k])
            write_png(folder / "depth" / f"{image:06d}.png", depth)
            for g, view in enumerate(views):
                mask = np.uint8(255) * view.mask
                write_png(folder / "mask_visib" / f"{image:06d}_{g:06d}.png", mask)
            cameras[image] = camera_row(frames, k) | {"camera": name, "time": time}
            poses[image] = [pose_row(view, models) for view in views]
            infos[image] = [info_row(view, models, frames, depth) for view in views]
    for name, rows in (("camera", cameras), ("gt", poses), ("gt_info", infos)):
        members = ",\n".join(member(str(image), data) for image, data in rows.items())
        write_items(folder / f"scene_{name}.json", "{", [members], "}")
    return {
        image: [(row["obj_id"], info) for row, info in zip(poses[image], rows, strict=True)]
        for image, rows in infos.items()
    }


def camera_row(frames: CameraFrames, k: int) -> dict[str, Any]:
    """Return the entry of an image in ``scene_camera.json``."""
    T_camera_world = inverse(frames.T_world_camera[k])
    return {
        "cam_K": frames.intrinsics.ravel().tolist(),
        "depth_scale": DEPTH_SCALE,
        "cam_R_w2c": T_camera_world[:3, :3].ravel().tolist(),
        "cam_t_w2c": (MM * T_camera_world[:3, 3]).tolist(),
    }


def pose_row(view: ObjectView, models: SceneModels) -> dict[str, Any]:
    """Return the entry of an object in ``scene_gt.json``."""
    key = key_of(view.recipe)
    origin = apply(view.T_camera_object, models.meshes[key].center)
    return {
        "obj_id": models.numbers[key].number,
        "cam_R_m2c": view.T_camera_object[:3, :3].ravel().tolist(),
        "cam_t_m2c": (MM * origin).tolist(),
    }


def info_row(
    view: ObjectView, models: SceneModels, frames: CameraFrames, depth: NDArray[np.uint16]
) -> Info:
    """Return the entry of an object in ``scene_gt_info.json``; ``depth`` is its image's, (H, W)."""
    visible = int(np.count_nonzero(view.mask))
    mesh = models.meshes[key_of(view.recipe)]
    points = apply(view.T_camera_object, mesh.vertices)
    pixels = _pixels(points, frames.intrinsics)
    whole = _pixels_of_all(view, visible, pixels, mesh.faces)
    return {
        "bbox_obj": NO_BOX if pixels is None or not visible else box_of_pixels(pixels),
        "bbox_visib": _toolkit_box(view.mask) if visible else NO_BOX,
        "px_count_all": whole,
        "px_count_valid": int(np.count_nonzero(view.mask & (depth > 0))),
        "px_count_visib": visible,
        "visib_fract": visible / whole if whole else 0.0,
    }


def _pixels(points: Array, K: Array) -> Array | None:
    """Return the pixels (V, 2) of points (V, 3) in the camera frame; None if one has no pixel."""
    if (points[:, 2] <= 0.0).any():
        return None
    with np.errstate(all="ignore"):
        pixels = project(points, K)
    return pixels if np.abs(pixels).max() < _FARTHEST else None


def _pixels_of_all(
    view: ObjectView, visible: int, pixels: Array | None, faces: NDArray[np.int64]
) -> int:
    """Return how many pixels an object has, with what is hidden or outside the image.

    In the image they follow from the visible share that the store has. The others, and those of an
    object of which nothing is visible, are the pixels of the model's silhouette.
    """
    inside = round(visible / view.visibility) if view.visibility > 0.0 else visible
    height, width = view.mask.shape
    if pixels is None or (inside and _is_within(pixels, height, width)):
        return inside
    drawn = silhouette(pixels, faces, (height, width))
    drawn_inside = int(np.count_nonzero(drawn[height : 2 * height, width : 2 * width]))
    return (inside or drawn_inside) + int(np.count_nonzero(drawn)) - drawn_inside


def _is_within(pixels: Array, height: int, width: int) -> bool:
    return bool((pixels >= -0.5).all() and (pixels < (width - 0.5, height - 0.5)).all())


def _toolkit_box(mask: NDArray[np.bool_]) -> list[int]:
    """Return the box of a mask as bop_toolkit does: width and height are largest less smallest."""
    x, y, width, height = box_of(mask)
    return [x, y, width - 1, height - 1]


def box_of_pixels(pixels: Array) -> list[int]:
    """Return the box of pixels (V, 2), which may reach beyond the image, as ``_toolkit_box``."""
    low, high = np.round(pixels.min(axis=0)), np.round(pixels.max(axis=0))
    return [int(value) for value in (*low, *(high - low))]
