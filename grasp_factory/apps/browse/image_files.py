"""An episode's images as files: PNG in full size, small JPEG for overviews."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from grasp_factory.apps.pictures.painting import (
    BgrImage,
    depth_picture,
    depth_span,
    label_palette,
    label_picture,
    put_outline,
)
from grasp_factory.core.enums import UNKNOWN, Label
from grasp_factory.core.thumbnail_size import thumbnail_height
from grasp_factory.dataset.dataset import Dataset

KINDS = ("rgb", "depth", "segmentation", "overlay")
THUMB_WIDTH = 200
"""Pixels."""
_TINT = 0.45
"""Share of a label's colour in the overlay, 0 to 1."""
_QUICK = (cv2.IMWRITE_PNG_COMPRESSION, 1)
_THUMB, _VIDEO = (cv2.IMWRITE_JPEG_QUALITY, 80), (cv2.IMWRITE_JPEG_QUALITY, 90)


def picture(dataset: Dataset, row: int, camera: str, kind: str, frame: int) -> bytes:
    """Return one of ``KINDS`` as a PNG file.

    Raises:
        StoreError: if the row is missing, quarantined or damaged.
    """
    return _encoded(".png", _image(dataset, row, camera, kind, frame), _QUICK)


def thumbnail(dataset: Dataset, row: int, camera: str, frame: int) -> bytes:
    """Return a small picture of what a camera sees, as a JPEG file ``THUMB_WIDTH`` wide.

    Among other objects, a line goes round the target.

    Raises:
        StoreError: if the row is missing, quarantined or damaged.
    """
    image = _image(dataset, row, camera, "rgb", frame)
    height = thumbnail_height(THUMB_WIDTH, image.shape)
    how = cv2.INTER_AREA if image.shape[1] >= THUMB_WIDTH else cv2.INTER_CUBIC
    small = np.asarray(cv2.resize(image, (THUMB_WIDTH, height), interpolation=how), np.uint8)
    if dataset.config.clutter.count > 1:
        labels = dataset.image(row, camera, "segmentation", frame)
        size = (THUMB_WIDTH, height)
        target = cv2.resize(
            (labels == Label.TARGET).astype(np.uint8), size, interpolation=cv2.INTER_NEAREST
        )
        put_outline(small, target > 0)
    return _encoded(".jpg", small, _THUMB)


def video_frame(rgb: NDArray[np.uint8]) -> bytes:
    """Return a frame (H, W, 3) of a video as a JPEG file."""
    return _encoded(".jpg", _bgr(rgb), _VIDEO)


def depth_range(dataset: Dataset, row: int, camera: str) -> tuple[float, float]:
    """Return the ``depth_span`` of a camera's images before an episode's attempt."""
    depth, labels = (dataset.image(row, camera, kind, 0) for kind in ("depth", "segmentation"))
    return depth_span(depth, labels, _far(dataset, row, camera))


def label_colors(names: list[str]) -> list[dict[str, object]]:
    """Return value, name and colour (#rrggbb) of each label that segmentations have."""
    colors = label_palette()[: len(names), ::-1].tolist()
    return [
        {"value": value, "name": name, "color": "#{:02x}{:02x}{:02x}".format(*color)}
        for value, (name, color) in enumerate(zip(names, colors, strict=True))
    ]


def _image(dataset: Dataset, row: int, camera: str, kind: str, frame: int) -> BgrImage:
    """Return one of ``KINDS``, BGR."""
    if kind == "depth":
        depth = dataset.image(row, camera, "depth", frame)
        near_and_far = depth_range(dataset, row, camera)
        return depth_picture(depth, *near_and_far, _far(dataset, row, camera))
    if kind == "segmentation":
        return label_picture(dataset.image(row, camera, "segmentation", frame))
    image = _bgr(dataset.image(row, camera, "rgb", frame))
    return image if kind == "rgb" else _tinted(image, dataset, row, camera, frame)


def _far(dataset: Dataset, row: int, camera: str) -> float:
    return dataset.spec(row).cameras[camera].far


def _tinted(image: BgrImage, dataset: Dataset, row: int, camera: str, frame: int) -> BgrImage:
    """Return an image whose robot and objects have their labels' colours."""
    labels = dataset.image(row, camera, "segmentation", frame)
    is_tinted = (labels >= Label.ARM) & (labels != UNKNOWN)
    mixed = cv2.addWeighted(image, 1.0 - _TINT, label_picture(labels), _TINT, 0.0)
    return np.asarray(np.where(is_tinted[..., None], mixed, image), np.uint8)


def _bgr(rgb: NDArray[np.uint8]) -> BgrImage:
    return np.ascontiguousarray(rgb[..., ::-1])


def _encoded(kind: str, image: BgrImage, how: tuple[int, int]) -> bytes:
    ok, data = cv2.imencode(kind, image, how)
    assert ok
    return bytes(data.tobytes())
