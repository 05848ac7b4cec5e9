"""When a gripper closes and opens, from its width over time."""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np

from grasp_factory.core.geometry import Array
from grasp_factory.signals.timeline import Ticks

_NEAR = 0.1
"""Share of a closing's travel by which a width may differ from where it began or ended."""


@dataclass(frozen=True, slots=True, kw_only=True)
class GripperClosing:
    """One closing, and the opening after it; times are ns of the host."""

    begins_ns: int
    closed_ns: int
    opens_ns: int | None
    """None if the gripper stays closed."""


def closings(times_ns: Ticks, width: Array, min_stroke_m: float) -> list[GripperClosing]:
    """Return every closing of a gripper: a fall of its width by a stroke or more.

    Turning points are found as in a zigzag: a motion ends when the width has come back by a stroke.

    Args:
        times_ns: (N,) ascending.
        width: (N,) m, without NaN.
        min_stroke_m: the smallest stroke.
    """
    turns = _turning_points(width, min_stroke_m)
    found = []
    for (first, is_wide), (last, _) in itertools.pairwise(turns):
        if not is_wide:
            continue
        near = _NEAR * float(width[first] - width[last])
        begin = first + int(np.flatnonzero(width[first:last] >= width[first] - near)[-1])
        closed = begin + int(np.flatnonzero(width[begin : last + 1] <= width[last] + near)[0])
        opens = _opening(turns, width, last, near)
        found.append(
            GripperClosing(
                begins_ns=int(times_ns[begin]),
                closed_ns=int(times_ns[closed]),
                opens_ns=None if opens is None else int(times_ns[opens]),
            )
        )
    return found


def _opening(turns: list[tuple[int, bool]], width: Array, closed: int, near: float) -> int | None:
    """Return the last sample before the gripper opens again."""
    after = [place for place, is_wide in turns if place > closed and is_wide]
    if not after:
        return None
    begin = after[0]
    while begin > closed and width[begin] > width[closed] + near:
        begin -= 1
    return begin


def _turning_points(width: Array, stroke: float) -> list[tuple[int, bool]]:
    """Return the place of each turn, and whether the gripper is wide there."""
    low = high = 0
    direction, turns = 0, []
    for k in range(1, len(width)):
        high = k if width[k] >= width[high] else high
        low = k if width[k] < width[low] else low
        if direction >= 0 and width[high] - width[k] >= stroke:
            turns.append((high, True))
            direction, low = -1, k
            high = k
        elif direction <= 0 and width[k] - width[low] >= stroke:
            turns.append((low, False))
            direction, high = 1, k
            low = k
    if direction and len(width):
        turns.append((low, False) if direction < 0 else (high, True))
    return turns
