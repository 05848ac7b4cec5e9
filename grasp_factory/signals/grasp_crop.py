"""Grasp-aligned crops: what the cameras see around a grasp, resampled into the grasp's own square.

Pixels become points, points go into the TCP frame, and the square is looked at along the approach:
an orthographic height map whose rows follow the TCP's x and whose columns follow y, the closing
direction. So a crop has the same scale and orientation for every camera, resolution and grasp,
which is what grasp-quality networks take. The idea of an image that is aligned with the grasp is
that of Dex-Net 2.0 (Mahler et al., 2017); here it is metric, and made from any number of views.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from grasp_factory.core.camera import project
from grasp_factory.core.episode import CameraImage
from grasp_factory.core.geometry import Array, inverse
from grasp_factory.core.linear import product, turned_back
from grasp_factory.core.serialization import check, check_range, is_integer

GLANCE = 1.7
"""How much farther apart pixels lie on a table that is seen at 37 degrees, as by `front`."""


@dataclass(frozen=True, slots=True, kw_only=True)
class CropShape:
    """A square of the plane across the approach, centred on the TCP."""

    size: int = 48
    """Pixels a side."""
    extent: float = 0.168
    """Metres a side: the iiwa's gripper, open, is 142 mm long."""
    reach: float = 0.15
    """Metres before and behind the TCP, along the approach, beyond which points are left out."""

    def __post_init__(self) -> None:
        check(is_integer(self.size) and 8 <= self.size <= 512, "size", self.size, "8 to 512 pixels")
        check_range(self, "extent", 0.01, 1.0, "m")
        check_range(self, "reach", 0.01, 1.0, "m")

    @property
    def cell(self) -> float:
        """Metres a pixel."""
        return self.extent / self.size


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class GraspRelief:
    """What is seen of the square around one grasp, but for the colours.

    Row i, column j covers the square of the TCP's x and y, metres, whose corner of least x and y
    lies ``CropShape.cell`` times (i, j) from that of the crop.
    """

    height: NDArray[np.float32]
    """(S, S) metres above the TCP, against the approach, of the highest point seen; NaN where none
    is."""
    label: NDArray[np.uint8]
    """(S, S) that point's value in the segmentation; 0 where none is."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class GraspCrop:
    """What is seen of the square around one grasp; rows and columns as in ``GraspRelief``."""

    height: NDArray[np.float32]
    """(S, S) metres above the TCP of the highest point seen; NaN where none is."""
    label: NDArray[np.uint8]
    """(S, S) that point's value in the segmentation; 0 where none is."""
    rgb: NDArray[np.uint8]
    """(S, S, 3) its colour; 0 where none is."""


def grasp_relief(
    images: Iterable[CameraImage], T_world_tcp: Array, shape: CropShape | None = None
) -> GraspRelief:
    """Return a grasp's crop without colours, which nothing reads then; see ``grasp_crop``."""
    shape = shape or CropShape()
    height, sources = _sources(images, T_world_tcp, shape)
    return GraspRelief(height=height, label=_labels(sources, shape))


def grasp_crop(
    images: Iterable[CameraImage], T_world_tcp: Array, shape: CropShape | None = None
) -> GraspCrop:
    """Return the crop of a grasp from what one or several cameras see.

    A pixel whose depth is 0, NaN or infinite shows nothing. Pixels that are coarser than the crop's
    are cut into parts, so that a plane has no holes. Of points of one height the last one counts.

    The same images, grasp and shape give the same bytes, whatever else is asked for: all sums are
    of three terms, in one order, in single precision, which is a micrometre's tenth at a metre.

    Args:
        images: Of the scene, of any resolution.
        T_world_tcp: The grasp, (4, 4).
        shape: Of the crop; None for the default.
    """
    shape = shape or CropShape()
    height, sources = _sources(images, T_world_tcp, shape)
    rgb = np.zeros((shape.size * shape.size, 3), np.uint8)
    for image, pixel in sources:
        rgb = np.where(pixel[:, None] >= 0, image.rgb.reshape(-1, 3).take(pixel, axis=0), rgb)
    return GraspCrop(
        height=height,
        label=_labels(sources, shape),
        rgb=rgb.reshape(shape.size, shape.size, 3),
    )


_Sources = list[tuple[CameraImage, NDArray[np.int64]]]
"""Each image with the number of the pixel, row by row, that a cell (S * S,) has from it, else -1;
of two images that have a cell the later one counts."""


def _sources(
    images: Iterable[CameraImage], T_world_tcp: Array, shape: CropShape
) -> tuple[NDArray[np.float32], _Sources]:
    """Return the heights (S, S), NaN where nothing is seen, and where they come from."""
    height = np.full(shape.size * shape.size, -np.inf, np.float32)
    sources: _Sources = []
    for image in images:
        highest, pixel = _highest(image, T_world_tcp, shape)
        wins = (pixel >= 0) & (highest >= height)
        height = np.where(wins, highest, height)
        sources.append((image, np.where(wins, pixel, -1)))
    height[height == -np.inf] = np.nan
    return height.reshape(shape.size, shape.size), sources


def _labels(sources: _Sources, shape: CropShape) -> NDArray[np.uint8]:
    label = np.zeros(shape.size * shape.size, np.uint8)
    for image, pixel in sources:
        label = np.where(pixel >= 0, image.segmentation.reshape(-1).take(pixel), label)
    return label.reshape(shape.size, shape.size)


@dataclass(frozen=True, slots=True, kw_only=True)
class _Window:
    """The part of an image in which a box shows, its pixels cut into parts."""

    rows: slice
    columns: slice
    parts: int
    """Of a pixel's side."""

    def depth(self, image: NDArray[np.float32]) -> NDArray[np.float32]:
        """Return the depth (H', W') of the parts, from that of an image (H, W).

        Within a pixel it follows the surface, as a plane that goes on to that neighbour to which
        the depth changes less. So a plane stays one, and an edge stays where it is.
        """
        if self.parts == 1:
            return np.ascontiguousarray(image[self.rows, self.columns])  # it is read four times
        rows, columns = (
            slice(max(0, part.start - 1), part.stop + 1) for part in (self.rows, self.columns)
        )
        inner = tuple(
            slice(part.start - around.start, part.stop - around.start)
            for part, around in ((self.rows, rows), (self.columns, columns))
        )
        around = image[rows, columns]
        with np.errstate(divide="ignore", over="ignore"):
            nearness = np.where(
                (around > 0.0) & (around < np.inf), np.float32(1.0) / around, np.nan
            )
            down, right = (_bend(nearness, axis)[inner] for axis in (0, 1))
            offsets = ((np.arange(self.parts) + 0.5) / self.parts - 0.5).astype(np.float32)
            inside = nearness[inner]
            parts = (
                inside[:, None, :, None]
                + down[:, None, :, None] * offsets[:, None, None]
                + right[:, None, :, None] * offsets
            )
            height, width = (side * self.parts for side in inside.shape)
            return np.asarray(1.0 / parts.reshape(height, width))

    def pixel(self, part: NDArray[np.int64], width: int) -> NDArray[np.int64]:
        """Return the number, in an image so wide, of the pixel that a part is of; -1 for -1."""
        across = max(1, (self.columns.stop - self.columns.start) * self.parts)
        row, column = np.divmod(part, across)
        if self.parts > 1:
            row, column = row // self.parts, column // self.parts
        pixel = (row + self.rows.start) * width + (column + self.columns.start)
        return np.where(part >= 0, pixel, -1)

    def rays(self, K: Array) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """Return the tangents of its columns' rays, (W',), and of its rows', (H', 1)."""
        u = _tangents(self.columns, self.parts, K[0, 2], K[0, 0])
        v = _tangents(self.rows, self.parts, K[1, 2], K[1, 1])
        return u, v[:, None]


def _bend(nearness: NDArray[np.float32], axis: int) -> NDArray[np.float32]:
    """Return the change per pixel along an axis, of a plane's inverse depth the same everywhere.

    Of the changes to both neighbours it is the smaller one, and 0 where they differ in sign or one
    is unknown: the minmod limiter of Roe (1986).
    """
    step = np.diff(nearness, axis=axis)
    none = np.zeros_like(np.take(nearness, [0], axis=axis))
    ahead, behind = np.concatenate([step, none], axis), np.concatenate([none, step], axis)
    least = np.where(np.abs(ahead) < np.abs(behind), ahead, behind)
    return np.asarray(np.where(ahead * behind > 0.0, least, np.float32(0.0)))


def _highest(
    image: CameraImage, T_world_tcp: Array, shape: CropShape
) -> tuple[NDArray[np.float32], NDArray[np.int64]]:
    """Return the greatest height that an image shows in each cell, (S * S,), and its pixel.

    The pixel is its number, row by row, and -1 where the image shows nothing.
    """
    T_tcp_camera = product(inverse(T_world_tcp), image.T_world_camera)
    window = _window(image, T_tcp_camera, shape)
    depth, (u, v) = window.depth(image.depth), window.rays(image.intrinsics)
    places = []
    with np.errstate(invalid="ignore", over="ignore"):  # depths without a value
        for a, b, c, t in _in_cells(T_tcp_camera, shape):
            place = (a * u + c) + b * v
            place *= depth  # in place, as fresh memory costs more than the sums
            place += t
            places.append(place)
    row, column, z = places
    reach, size = np.float32(shape.reach), np.float32(shape.size)
    inside = (depth > 0.0) & (z > -reach) & (z < reach)
    for place in (row, column):
        inside &= place >= 0.0
        inside &= place < size
    seen = np.flatnonzero(inside)
    row_of, column_of = (place.take(seen).astype(np.int64) for place in (row, column))
    cell = row_of * shape.size + column_of
    height = 0.0 - z.take(seen)  # never -0.0, which is other bytes
    highest = np.full(shape.size * shape.size, -np.inf, np.float32)
    np.maximum.at(highest, cell, height)
    top = np.flatnonzero(height == highest.take(cell))
    which = np.full(shape.size * shape.size, -1, np.int64)
    which[cell.take(top)] = seen.take(top)  # of several the last one stays
    return highest, window.pixel(which, image.depth.shape[1])


def _in_cells(T_tcp_camera: Array, shape: CropShape) -> NDArray[np.float32]:
    """Return what maps points of the camera to rows and columns of the crop and z, (3, 4)."""
    per_metre = 1.0 / shape.cell
    out = T_tcp_camera[:3] * np.array([[per_metre], [per_metre], [1.0]])
    out[:2, 3] += shape.size / 2.0
    return np.asarray(out, dtype=np.float32)


_CORNERS = np.array(list(itertools.product((-1.0, 1.0), repeat=3)))
"""Of a box about the origin whose half sides are 1, (8, 3)."""


def _window(image: CameraImage, T_tcp_camera: Array, shape: CropShape) -> _Window:
    """Return where the box shows that the crop looks into; the whole image if it is around it.

    Pixels get as many parts as it takes for a plane to have no holes.
    """
    half = shape.extent / 2.0
    at_tcp = _CORNERS * np.array([half, half, shape.reach])
    corners = turned_back(T_tcp_camera[:3, :3], at_tcp - T_tcp_camera[:3, 3])  # at the camera
    height, width = image.depth.shape
    spacing = GLANCE * float(corners[:, 2].max()) / float(image.intrinsics[0, 0])
    parts = max(1, math.ceil(spacing / shape.cell))
    if corners[:, 2].min() <= 0.0:  # a part of it is behind the camera
        return _Window(rows=slice(0, height), columns=slice(0, width), parts=parts)
    pixels = project(corners, image.intrinsics)
    (left, top), (right, bottom) = pixels.min(axis=0).tolist(), pixels.max(axis=0).tolist()
    rows, columns = _span(top, bottom, height), _span(left, right, width)
    return _Window(rows=rows, columns=columns, parts=parts)


def _span(low: float, high: float, size: int) -> slice:
    start, stop = math.floor(low), math.ceil(high) + 1
    return slice(min(max(start, 0), size), min(max(stop, 0), size))


def _tangents(pixels: slice, parts: int, centre: float, focal: float) -> NDArray[np.float32]:
    """Return the tangents of the rays of a window's columns (or rows), (W',)."""
    number = np.arange(pixels.start * parts, pixels.stop * parts)
    at = number + (0.5 - parts * (centre + 0.5))  # parts from the middle of the image
    return np.asarray(at / (parts * focal), dtype=np.float32)
