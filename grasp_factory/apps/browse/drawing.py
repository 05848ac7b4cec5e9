"""Pictures of an episode's images as files: PNG to look at closely, small JPEG for overviews."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from grasp_factory.apps.pictures.painting import (
    BgrImage,
    depth_picture,
    label_palette,
    label_picture,
)
from grasp_factory.core.enums import Label
from grasp_factory.dataset.dataset import Dataset

KINDS = ("rgb", "depth", "segmentation", "overlay")
THUMB_WIDTH = 200
"""Pixels."""
_TINT = 0.45
"""Of a label's colour in the overlay."""
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

    Raises:
        StoreError: if the row is missing, quarantined or damaged.
    """
    image = _image(dataset, row, camera, "rgb", frame)
    height = max(1, round(THUMB_WIDTH * image.shape[0] / image.shape[1]))
    how = cv2.INTER_AREA if image.shape[1] >= THUMB_WIDTH else cv2.INTER_CUBIC
    small = cv2.resize(image, (THUMB_WIDTH, height), interpolation=how)
    return _encoded(".jpg", np.asarray(small, np.uint8), _THUMB)


def video_frame(rgb: NDArray[np.uint8]) -> bytes:
    """Return a frame (H, W, 3) of a video as a JPEG file."""
    return _encoded(".jpg", _bgr(rgb), _VIDEO)


def depth_span(dataset: Dataset, row: int, camera: str) -> tuple[float, float]:
    """Return the depths, metres, between which an episode's depth colours run.

    They are those of the table and what lies on it before the attempt.
    """
    labels = dataset.image(row, camera, "segmentation", 0)
    depth = dataset.image(row, camera, "depth", 0)
    values = depth[((labels == Label.TABLE) | (labels >= Label.TARGET)) & np.isfinite(depth)]
    if not len(values):
        return 0.0, 1.0
    low, high = np.percentile(values, [1.0, 99.0])
    return float(low), float(high)


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
        far = dataset.spec(row).cameras[camera].far
        depth = dataset.image(row, camera, "depth", frame)
        return depth_picture(depth, *depth_span(dataset, row, camera), far)
    if kind == "segmentation":
        return label_picture(dataset.image(row, camera, "segmentation", frame))
    image = _bgr(dataset.image(row, camera, "rgb", frame))
    return image if kind == "rgb" else _tinted(image, dataset, row, camera, frame)


def _tinted(image: BgrImage, dataset: Dataset, row: int, camera: str, frame: int) -> BgrImage:
    """Return an image whose robot and objects have their labels' colours."""
    labels = dataset.image(row, camera, "segmentation", frame)
    mixed = cv2.addWeighted(image, 1.0 - _TINT, label_picture(labels), _TINT, 0.0)
    return np.asarray(np.where((labels >= Label.ARM)[..., None], mixed, image), np.uint8)


def _bgr(rgb: NDArray[np.uint8]) -> BgrImage:
    return np.ascontiguousarray(rgb[..., ::-1])


def _encoded(kind: str, image: BgrImage, how: tuple[int, int]) -> bytes:
    ok, data = cv2.imencode(kind, image, how)
    assert ok
    return bytes(data.tobytes())
