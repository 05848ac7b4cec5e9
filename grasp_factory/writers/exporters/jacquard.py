"""The layout of the Jacquard grasping data set, which GG-CNN and GR-ConvNet read.

``<object>/<n>_<object>_RGB.png``, ``_perfect_depth.tiff`` (float32, metres), ``_mask.png`` and
``_grasps.txt`` with a line ``x;y;theta;w;h``, in pixels of an image of 1024 x 1024 and degrees.
<object> has 32 hexadecimal digits, as in Jacquard, and n is the number of the episode. Layout:
https://jacquard.liris.cnrs.fr and https://github.com/dougsm/ggcnn, utils/data/jacquard_data.py
"""

from __future__ import annotations

import hashlib
import math
from functools import partial

from grasp_factory.core.episode import Episode
from grasp_factory.writers.exporters.base import Exporter
from grasp_factory.writers.exporters.grasp_rectangle import GraspRectangle
from grasp_factory.writers.exporters.rectangle_dataset import (
    Listed,
    RectangleLayout,
    RectangleSettings,
    excludes,
    join_tables,
    rectangle_contents,
    write_rectangles,
)

SIDE = 1024
"""Pixels of each side of Jacquard's images; readers divide its coordinates by this number."""


def jacquard_name(place: int, episode: Episode) -> tuple[str, str]:
    """Return the folder of the episode's target, and the beginning of its file names."""
    columns = episode.columns
    target = f"{columns['object_set']}\0{columns['object_id']}"
    folder = hashlib.sha256(target.encode()).hexdigest()[:32]
    return folder, f"{place}_{folder}"


def jacquard_line(rectangle: GraspRectangle) -> str:
    """Return the line of a grasp.

    Jacquard's angles grow clockwise in the image, as ours do; GG-CNN negates them.
    """
    theta = math.degrees(rectangle.angle)
    values = (rectangle.x, rectangle.y, theta, rectangle.opening, rectangle.jaw)
    return ";".join(f"{value:.4f}" for value in values) + "\n"


LAYOUT = RectangleLayout(
    size=(SIDE, SIDE),
    name=jacquard_name,
    rgb="_RGB.png",
    depth="_perfect_depth.tiff",
    mask="_mask.png",
    lists={Listed.GOOD: "_grasps.txt", Listed.FAILED: "_failures.txt"},
    text=jacquard_line,
)

JACQUARD = Exporter(
    name="jacquard",
    description="images from above with grasp rectangles, for GG-CNN and GR-ConvNet",
    contents=rectangle_contents(LAYOUT),
    excludes=excludes,
    write_part=partial(write_rectangles, LAYOUT),
    series=(),
    finish=join_tables,
    parameters=RectangleSettings,
)
