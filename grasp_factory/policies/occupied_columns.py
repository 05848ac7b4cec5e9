"""The occupied space on the table, estimated from images: columns below the visible surfaces."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from grasp_factory.core.enums import Label
from grasp_factory.core.episode import SceneView
from grasp_factory.core.geometry import Array
from grasp_factory.policies.base import visible_points

CELL = 0.004
"""Metres: side of a column."""
LEVEL = 0.010
"""Vertical distance between the points of a column, metres."""


@dataclass(frozen=True, slots=True)
class SolidColumns:
    """Square columns from the table to the highest visible point in each column."""

    xy: Array
    """(K, 2) metres, world frame: the centres of the columns."""
    tops: Array
    """(K,) metres: the heights of the columns."""

    @classmethod
    def under(cls, points: Array) -> SolidColumns:
        """Return the columns under points (N, 3), world frame, metres."""
        if not len(points):
            return cls(np.zeros((0, 2)), np.zeros(0))
        cells = np.floor(points[:, :2] / CELL).astype(np.int64)
        lowest = cells.min(axis=0)
        stride = int(cells[:, 1].max() - lowest[1]) + 1
        keys = (cells[:, 0] - lowest[0]) * stride + cells[:, 1] - lowest[1]
        found, inverse = np.unique(keys, return_inverse=True)
        tops = np.zeros(len(found))
        np.maximum.at(tops, inverse, points[:, 2])
        indices = np.stack([found // stride, found % stride], axis=1) + lowest
        return cls((indices.astype(np.float64) + 0.5) * CELL, tops)

    def centroid(self) -> Array:
        """Return the centroid of the columns' volume, (3,) metres, world frame."""
        weights = self.tops + 1e-9  # columns of height 0 still count by their area
        weights /= weights.sum()
        x, y = (weights[:, None] * self.xy).sum(axis=0)
        return np.array([x, y, (weights * self.tops).sum() / 2.0])

    def points(self) -> Array:
        """Return points (N, 3) that fill the columns, ``LEVEL`` apart, including the tops."""
        counts = np.floor(self.tops / LEVEL).astype(int) + 1
        rows = np.repeat(np.arange(len(self.tops)), counts)
        below = np.arange(len(rows)) - np.repeat(np.cumsum(counts) - counts, counts)
        heights = self.tops[rows] - below * LEVEL
        return np.column_stack([self.xy[rows], heights])


def object_points(view: SceneView) -> Array:
    """Return the visible points (N, 3) of all objects, world frame, metres."""
    return visible_points(view, lambda labels: labels >= Label.TARGET)
