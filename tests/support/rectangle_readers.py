"""Grasp rectangles read as GG-CNN reads them: its formulas, without its libraries.

From https://github.com/dougsm/ggcnn, utils/dataset_processing/grasp.py. A rectangle is its corners
as (row, column), and GG-CNN's angles are positive against the clock.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from grasp_factory.core.geometry import Array


@dataclass(frozen=True, slots=True, kw_only=True)
class ReadGrasp:
    """A grasp as GG-CNN sees it, pixels."""

    centre: Array
    """Row and column."""
    angle: float
    """rad, -pi/2 to pi/2, from the image's right towards its upper side."""
    length: float
    width: float


def read_grasp(points: Array) -> ReadGrasp:
    """Return the grasp of a rectangle's corners, (4, 2) as (row, column)."""
    down, across = points[1] - points[0]
    return ReadGrasp(
        centre=points.mean(axis=0),
        angle=float((np.arctan2(-down, across) + np.pi / 2) % np.pi - np.pi / 2),
        length=float(np.hypot(down, across)),
        width=float(np.hypot(*(points[2] - points[1]))),
    )


def read_jacquard(path: Path) -> list[ReadGrasp]:
    """Return the grasps of a ``_grasps.txt``: load_from_jacquard_file, Grasp.as_gr."""
    grasps = []
    for line in path.read_text().splitlines():
        x, y, theta, length, width = (float(value) for value in line.split(";"))
        angle = -theta / 180.0 * np.pi
        xo, yo = np.cos(angle), np.sin(angle)
        y1, x1 = y + length / 2 * yo, x - length / 2 * xo
        y2, x2 = y - length / 2 * yo, x + length / 2 * xo
        grasps.append(
            read_grasp(
                np.array(
                    [
                        [y1 - width / 2 * xo, x1 - width / 2 * yo],
                        [y2 - width / 2 * xo, x2 - width / 2 * yo],
                        [y2 + width / 2 * xo, x2 + width / 2 * yo],
                        [y1 + width / 2 * xo, x1 + width / 2 * yo],
                    ]
                )
            )
        )
    return grasps


def read_cornell(path: Path) -> list[ReadGrasp]:
    """Return the grasps of a ``cpos.txt``: load_from_cornell_file, which rounds to whole pixels."""
    corners = [[float(value) for value in line.split()] for line in path.read_text().splitlines()]
    rectangles = np.array(corners).reshape(-1, 4, 2)[..., ::-1]
    return [read_grasp(points) for points in rectangles]
