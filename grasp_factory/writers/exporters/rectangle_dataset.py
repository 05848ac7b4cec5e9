"""Data sets of images from above with grasp rectangles, in the layouts of several projects.

Each episode is an image with one grasp. A good grasp is in one list beside the image and a failed
one in another; ``grasps.csv`` has all grasps, also those that are in no list, and says why.
"""

from __future__ import annotations

import math
import shutil
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from enum import Enum
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from grasp_factory.core.episode import Episode
from grasp_factory.core.serialization import check_range
from grasp_factory.writers.exporters.base import (
    REAL_ROWS,
    REAL_SERIES,
    ExportContents,
    ExportJob,
    ExportPart,
)
from grasp_factory.writers.exporters.grasp_rectangle import GraspRectangle
from grasp_factory.writers.exporters.images import write_png
from grasp_factory.writers.exporters.overhead_view import (
    OverheadView,
    overhead_camera,
    overhead_view,
    without_grasp,
)
from grasp_factory.writers.exporters.selection import Selection

TABLE = "grasps.csv"
HEADER = "episode,files,listed,outcome,x,y,theta_deg,opening,jaw,depth_m,tilt_deg\n"
DEFLATE = (cv2.IMWRITE_TIFF_COMPRESSION, 8, cv2.IMWRITE_TIFF_PREDICTOR, 1)
"""Lossless: Deflate (8 in supplement 2 of TIFF 6.0, 2002) without a predictor.

OpenCV's default, a predictor of floats, cannot be read by tifffile unless imagecodecs is installed.
"""


@dataclass(frozen=True, slots=True, kw_only=True)
class RectangleSettings:
    """Settings of the formats with grasp rectangles."""

    camera: str = ""
    """The camera whose images are written; empty for ``overhead``, which must then be there."""
    zoom: float = 1.0
    """1 for the largest part of the image that fits; 2 for half of its sides."""
    max_tilt_deg: float = 20.0
    """Largest angle between the approach and the camera's axis of a grasp that is listed."""

    def __post_init__(self) -> None:
        check_range(self, "zoom", 1.0, 100.0)
        check_range(self, "max_tilt_deg", 0.0, 180.0, "degrees")


class Listed(Enum):
    """In which list of its image a grasp is."""

    GOOD = "good"
    FAILED = "failed"
    TILTED = "tilted"
    """In none: it approaches at too large an angle to the camera's axis."""
    OUTSIDE = "outside"
    """In none: the TCP is not in the image."""


@dataclass(frozen=True, slots=True, kw_only=True)
class RectangleLayout:
    """The names and sizes of the files of a layout."""

    size: tuple[int, int]
    """Width and height of the images, pixels."""
    name: Callable[[int, Episode], tuple[str, str]]
    """Returns the folder and the beginning of the names of an episode's files."""
    rgb: str
    """The end of the name of the colour image; the same for the other files."""
    depth: str
    mask: str
    lists: Mapping[Listed, str]
    text: Callable[[GraspRectangle], str]
    """Returns a grasp as text for its list."""


def excludes(episodes: Selection, settings: RectangleSettings) -> Mapping[str, NDArray[np.bool_]]:
    """Exclude episodes without a grasp, and those whose camera was not calibrated.

    Raises:
        UnknownNameError: for an unknown camera.
        UsageError: if no camera is named and there is no ``overhead``.
    """
    camera = overhead_camera(episodes, settings.camera)
    return without_grasp(episodes, [camera])


def write_rectangles(layout: RectangleLayout, job: ExportJob, part: ExportPart) -> None:
    """Write the files of some episodes; their rows of the table go aside."""
    settings: RectangleSettings = job.settings
    camera = overhead_camera(job.episodes, settings.camera)
    with (job.aside / f"{part.number:08d}.csv").open("w", encoding="ascii") as table:
        for place, episode in part.episodes:
            view = overhead_view(episode.cameras[camera], layout.size, settings.zoom)
            rectangle = view.rectangle(episode)
            where = listed(episode, rectangle, settings.max_tilt_deg)
            folder, name = layout.name(place, episode)
            (job.folder / folder).mkdir(exist_ok=True)
            start = job.folder / folder / name
            write_images(layout, start, view)
            if rectangle and where in layout.lists:
                _beside(start, layout.lists[where]).write_text(layout.text(rectangle))
            table.write(row(place, f"{folder}/{name}", where, episode, rectangle))


def write_images(layout: RectangleLayout, start: Path, view: OverheadView) -> None:
    """Write the images of a view to files whose paths begin with ``start``."""
    write_png(_beside(start, layout.rgb), view.rgb)
    write_png(_beside(start, layout.mask), view.objects)
    _beside(start, layout.depth).write_bytes(tiff(view.depth))


def _beside(start: Path, end: str) -> Path:
    return start.with_name(start.name + end)


def listed(episode: Episode, rectangle: GraspRectangle | None, max_tilt_deg: float) -> Listed:
    """Return where an episode's grasp is listed."""
    if rectangle is None:
        return Listed.OUTSIDE
    if math.degrees(rectangle.tilt) > max_tilt_deg:
        return Listed.TILTED
    return Listed.GOOD if episode.success else Listed.FAILED


def row(
    place: int, files: str, where: Listed, episode: Episode, rectangle: GraspRectangle | None
) -> str:
    """Return an episode's row of the table; a grasp that is not in the image has no numbers."""
    cells = [str(place), files, where.value, episode.outcome.name.lower()]
    return ",".join(cells + (numbers(rectangle) if rectangle else [""] * 7)) + "\n"


def numbers(rectangle: GraspRectangle) -> list[str]:
    """Return a rectangle's values in the order of the table."""
    theta, tilt = math.degrees(rectangle.angle), math.degrees(rectangle.tilt)
    sides = (rectangle.opening, rectangle.jaw)
    values = (rectangle.x, rectangle.y, theta, *sides, rectangle.depth, tilt)
    return [f"{value:.4f}" for value in values]


def tiff(image: NDArray[np.float32]) -> bytes:
    """Return an image (H, W) as the bytes of a TIFF file."""
    _, data = cv2.imencode(".tiff", image, DEFLATE)
    return data.tobytes()


def join_tables(job: ExportJob, parts: Sequence[None]) -> None:
    """Write the table of all episodes."""
    with (job.folder / TABLE).open("wb") as table:
        table.write(HEADER.encode("ascii"))
        for path in sorted(job.aside.iterdir()):
            with path.open("rb") as rows:
                shutil.copyfileobj(rows, table)


def rectangle_contents(layout: RectangleLayout) -> ExportContents:
    """Return what a layout has of the store's arrays."""
    good, failed = layout.lists[Listed.GOOD], layout.lists[Listed.FAILED]
    width, height = layout.size
    return ExportContents(
        written=("cameras/*/rgb", "cameras/*/depth", "cameras/*/segmentation"),
        left_out={
            "cameras/*": "the layout has images and grasps only; the recipe has the camera's pose",
            "streams/*": "the layout has no time series",
            **dict.fromkeys(("imu/*", *REAL_SERIES), "the layout has no time series"),
            "videos/*": "the layout has no videos",
        },
        treatment={
            "images": f"of one camera before the attempt, resampled to {width} x {height}: each"
            " pixel has the value of the nearest one; depth in metres",
            "segmentation": f"{layout.mask} is 255 at all objects and 0 elsewhere",
            "missing depth": "filled from the surroundings, because readers cannot use NaN",
            "good grasps": f"in {good}; the rectangle is the opening before closing by the width"
            " of a pad",
            "failed grasps": f"in {failed}, which readers do not open",
            "tilted or outside": f"in no list: {TABLE} names the grasps that approach at more than"
            " max_tilt_deg to the camera's axis or are not in the image",
            "no grasp": "the episode is left out",
            REAL_ROWS: "left out if the grasp's pose was not measured, or the camera not"
            f" calibrated; {layout.mask} is 0, as objects are not labelled",
        },
    )
