"""Grasp-aligned crops: images around a grasp, resampled into a square that is aligned with it.

Pixels become points, and points are transformed into the TCP frame. A crop is an orthographic
height map along the approach: its rows follow the TCP's x, and its columns follow y, the closing
direction. So a crop has the same scale and orientation for every camera, resolution and grasp, as
grasp-quality networks need. Dex-Net 2.0 (Mahler et al., 2017) introduced images that are aligned
with the grasp; here the image is metric, and made from any number of views.
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
"""Factor by which pixels are farther apart on a table that is seen at 37 degrees, as by `front`."""
MOST_POINTS = 2**26
"""Most points that an image is divided into: four for each pixel of the largest image."""


@dataclass(frozen=True, slots=True, kw_only=True)
class CropShape:
    """A square in the plane perpendicular to the approach, centred on the TCP."""

    size: int = 48
    """Pixels per side."""
    extent: float = 0.168
    """Metres per side; the open gripper of the iiwa is 142 mm long."""
    reach: float = 0.15
    """Points farther than this from the TCP along the approach, metres, are left out."""

    def __post_init__(self) -> None:
        check(is_integer(self.size) and 8 <= self.size <= 512, "size", self.size, "8 to 512 pixels")
        check_range(self, "extent", 0.01, 1.0, "m")
        check_range(self, "reach", 0.01, 1.0, "m")

    @property
    def cell(self) -> float:
        """Metres per pixel."""
        return self.extent / self.size


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class GraspRelief:
    """Heights and labels in the square around one grasp, without colours.

    Row i, column j covers a square cell in the TCP's x and y. The cell's corner of least x and y is
    ``CropShape.cell`` times (i, j), metres, from the crop's corner of least x and y.
    """

    height: NDArray[np.float32]
    """(S, S) height of the highest visible point above the TCP, against the approach, metres; NaN
    where there is no point."""
    label: NDArray[np.uint8]
    """(S, S) value of that point in the segmentation; 0 where there is no point."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class GraspCrop:
    """Heights, labels and colours around one grasp; rows and columns as in ``GraspRelief``."""

    height: NDArray[np.float32]
    """(S, S) height of the highest visible point above the TCP, metres; NaN where there is none."""
    label: NDArray[np.uint8]
    """(S, S) value of that point in the segmentation; 0 where there is no point."""
    rgb: NDArray[np.uint8]
    """(S, S, 3) colour of that point; 0 where there is no point."""


def grasp_relief(
    images: Iterable[CameraImage], T_world_tcp: Array, shape: CropShape | None = None
) -> GraspRelief:
    """Return a grasp's crop without colours, and do not read them; see ``grasp_crop``."""
    shape = shape or CropShape()
    height, sources = _sources(images, T_world_tcp, shape)
    return GraspRelief(height=height, label=_labels(sources, shape))


def grasp_crop(
    images: Iterable[CameraImage], T_world_tcp: Array, shape: CropShape | None = None
) -> GraspCrop:
    """Return the crop of a grasp from the images of one or several cameras.

    A pixel whose depth is 0, NaN or infinite has no point. Pixels that are coarser than the crop's
    are divided into parts, so that a plane has no holes. Of points with the same height in a cell,
    the last one counts.

    The same images, grasp and shape always yield the same bytes: all sums have three terms, in one
    order, in single precision, which is 0.1 micrometre at one metre.

    Args:
        images: Images of the scene, of any resolution.
        T_world_tcp: The grasp, (4, 4).
        shape: Shape of the crop; None for the default.

    Raises:
        ConfigError: if the grasp is not near what the images show.
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
"""Each image, and for each cell (S * S,) the index of its pixel, row by row, or -1 if it has none.
If two images have a pixel for a cell, the later image counts."""


def _sources(
    images: Iterable[CameraImage], T_world_tcp: Array, shape: CropShape
) -> tuple[NDArray[np.float32], _Sources]:
    """Return the heights (S, S), NaN where no point is visible, and their pixels."""
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
    """The part of an image in which a box is visible, with its pixels divided into parts."""

    rows: slice
    columns: slice
    parts: int
    """Number of parts along each side of a pixel."""

    def depth(self, image: NDArray[np.float32]) -> NDArray[np.float32]:
        """Return the depth (H', W') of the parts, from the depth of an image (H, W).

        Within a pixel the depth follows a plane towards the neighbour to which the depth changes
        less. So a plane stays a plane, and an edge stays where it is.
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
        """Return the index of the pixel that contains a part, for an image width; -1 for -1."""
        across = max(1, (self.columns.stop - self.columns.start) * self.parts)
        row, column = np.divmod(part, across)
        if self.parts > 1:
            row, column = row // self.parts, column // self.parts
        pixel = (row + self.rows.start) * width + (column + self.columns.start)
        return np.where(part >= 0, pixel, -1)

    def rays(self, K: Array) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """Return the tangents of the rays of its columns, (W',), and of its rows, (H', 1)."""
        u = _tangents(self.columns, self.parts, K[0, 2], K[0, 0])
        v = _tangents(self.rows, self.parts, K[1, 2], K[1, 1])
        return u, v[:, None]


def _bend(nearness: NDArray[np.float32], axis: int) -> NDArray[np.float32]:
    """Return the change of inverse depth per pixel along an axis; on a plane it is constant.

    It is the smaller one of the changes to the two neighbours. It is 0 where they differ in sign or
    one is unknown: the minmod limiter of Roe (1986).
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

    The pixel is an index, row by row, and -1 where the image shows no point.
    """
    T_tcp_camera = product(inverse(T_world_tcp), image.T_world_camera)
    window = _window(image, T_tcp_camera, shape)
    depth, (u, v) = window.depth(image.depth), window.rays(image.intrinsics)
    places = []
    with np.errstate(invalid="ignore", over="ignore"):  # invalid depths
        for a, b, c, t in _in_cells(T_tcp_camera, shape):
            place = (a * u + c) + b * v
            place *= depth  # in place: new memory costs more time than the sums
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
    height = 0.0 - z.take(seen)  # never -0.0, whose bytes differ from 0.0
    highest = np.full(shape.size * shape.size, -np.inf, np.float32)
    np.maximum.at(highest, cell, height)
    top = np.flatnonzero(height == highest.take(cell))
    which = np.full(shape.size * shape.size, -1, np.int64)
    which[cell.take(top)] = seen.take(top)  # the last one of several counts
    return highest, window.pixel(which, image.depth.shape[1])


def _in_cells(T_tcp_camera: Array, shape: CropShape) -> NDArray[np.float32]:
    """Return the matrix (3, 4) that maps camera points to rows, columns and z of the crop."""
    per_metre = 1.0 / shape.cell
    out = T_tcp_camera[:3] * np.array([[per_metre], [per_metre], [1.0]])
    out[:2, 3] += shape.size / 2.0
    return np.asarray(out, dtype=np.float32)


_CORNERS = np.array(list(itertools.product((-1.0, 1.0), repeat=3)))
"""Corners, (8, 3), of a box around the origin whose half sides are 1."""


def _window(image: CameraImage, T_tcp_camera: Array, shape: CropShape) -> _Window:
    """Return the part of an image in which the crop's box is visible.

    It is the whole image if a part of the box is behind the camera. Pixels are divided into enough
    parts that a plane has no holes.
    """
    half = shape.extent / 2.0
    at_tcp = _CORNERS * np.array([half, half, shape.reach])
    corners = turned_back(T_tcp_camera[:3, :3], at_tcp - T_tcp_camera[:3, 3])  # at the camera
    height, width = image.depth.shape
    spacing = GLANCE * float(corners[:, 2].max()) / float(image.intrinsics[0, 0])
    check(math.isfinite(spacing), "T_world_tcp", spacing, "a pose that the camera can see")
    parts = max(1, math.ceil(spacing / shape.cell))
    rows, columns = slice(0, height), slice(0, width)
    if corners[:, 2].min() > 0.0:  # no part of the box is behind the camera
        pixels = project(corners, image.intrinsics)
        (left, top), (right, bottom) = pixels.min(axis=0).tolist(), pixels.max(axis=0).tolist()
        rows, columns = _span(top, bottom, height), _span(left, right, width)
    points = (rows.stop - rows.start) * (columns.stop - columns.start) * parts * parts
    check(points <= MOST_POINTS, "T_world_tcp", points, f"at most {MOST_POINTS} points of an image")
    return _Window(rows=rows, columns=columns, parts=parts)


def _span(low: float, high: float, size: int) -> slice:
    start, stop = math.floor(low), math.ceil(high) + 1
    return slice(min(max(start, 0), size), min(max(stop, 0), size))


def _tangents(pixels: slice, parts: int, centre: float, focal: float) -> NDArray[np.float32]:
    """Return the tangents of the rays of a window's columns (or rows), (W',)."""
    number = np.arange(pixels.start * parts, pixels.stop * parts)
    at = number + (0.5 - parts * (centre + 0.5))  # parts from the middle of the image
    return np.asarray(at / (parts * focal), dtype=np.float32)
