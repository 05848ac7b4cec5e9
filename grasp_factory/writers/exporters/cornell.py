"""The layout of the Cornell grasping data set, as GG-CNN and GR-ConvNet read it.

``<nn>/pcd<nn><mm>r.png``, ``d.tiff`` (float32, metres), ``cpos.txt`` and ``cneg.txt`` with the four
corners of a rectangle, one ``x y`` in each line, in pixels of an image of 640 x 480. nn and mm are
the number of the episode divided by 100 and the remainder. Layout:
https://github.com/dougsm/ggcnn, utils/data/cornell_data.py: it takes the first edge as the closing
direction, and d.tiff files come from its tool generate_cornell_depth.py.
"""

from __future__ import annotations

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

SIZE = (640, 480)
"""Pixels of Cornell's images; readers crop them to fit into this size."""


def cornell_name(place: int, episode: Episode) -> tuple[str, str]:
    """Return the folder of an episode, and the beginning of its file names."""
    folder = f"{place // 100:02d}"
    return folder, f"pcd{folder}{place % 100:02d}"


def cornell_lines(rectangle: GraspRectangle) -> str:
    """Return the lines of a grasp's corners."""
    return "".join(f"{x:.4f} {y:.4f}\n" for x, y in rectangle.corners().tolist())


LAYOUT = RectangleLayout(
    size=SIZE,
    name=cornell_name,
    rgb="r.png",
    depth="d.tiff",
    mask="m.png",
    lists={Listed.GOOD: "cpos.txt", Listed.FAILED: "cneg.txt"},
    text=cornell_lines,
)

CORNELL = Exporter(
    name="cornell",
    description="images from above with corners of grasp rectangles, for GG-CNN and GR-ConvNet",
    contents=rectangle_contents(LAYOUT),
    excludes=excludes,
    write_part=partial(write_rectangles, LAYOUT),
    series=(),
    finish=join_tables,
    parameters=RectangleSettings,
)
