"""The colours of everything that people look at: outcomes, phases, curves, labels, depth, force.

Pictures, plots, the pages and the exports take their colours from here, so that a colour means the
same everywhere. ``tests/core/test_palette.py`` computes that colour-blind people can tell them
apart. A colour is ``#rrggbb``.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, slots=True)
class Paint:
    """A colour on white paper, and the colour that stands for the same on a dark page."""

    light: str
    dark: str


OUTCOMES: Mapping[str, Paint] = {
    "success": Paint("#0062b1", "#5aaeff"),
    "never_settled": Paint("#005f5b", "#5cf6f2"),
    "left_workspace": Paint("#0f7446", "#b2f5c5"),
    "no_plan": Paint("#353000", "#e8e17e"),
    "unreachable": Paint("#796436", "#f3b540"),
    "collision": Paint("#b53a00", "#ff8552"),
    "no_contact": Paint("#602b35", "#fa678d"),
    "lost_in_lift": Paint("#99497e", "#fbc0dd"),
    "lost_in_hold": Paint("#950b80", "#cfabdb"),
    "lost_in_shake": Paint("#490e64", "#ae8bbb"),
    "unstable": Paint("#933f1d", "#c79769"),
}
"""By the names of ``Outcome``."""
QUARANTINED = Paint("#646a64", "#a1a3a3")
SUCCESS = OUTCOMES["success"]
FAILURES = Paint("#9aa5b4", "#5d6b7d")
"""All outcomes but success together, where successes are counted against them."""

PHASES: Mapping[str, Paint] = {
    "pregrasp": Paint("#093c4d", "#bed3fe"),
    "approach": Paint("#168096", "#4d8a98"),
    "close": Paint("#8e6e28", "#f6bf4c"),
    "lift": Paint("#5b7d58", "#64f3bd"),
    "hold": Paint("#4d1674", "#9176de"),
    "shake": Paint("#7f071f", "#e5484d"),
}
"""By the names of ``Phase``. A phase always has its name beside its colour."""
CURVES = (
    Paint("#2886ff", "#3e8bf6"),
    Paint("#ab1605", "#f74920"),
    Paint("#03a057", "#b0f4c3"),
    Paint("#58144e", "#bd6ab2"),
    Paint("#b28d24", "#f8d97d"),
    Paint("#25668d", "#72d0fd"),
    Paint("#5b6265", "#a9acad"),
)
"""Of a group's curves, in turn."""

NOTHING = "#404246"
"""Pixels where a depth image sees nothing, and pixels that were not labelled."""
TARGET = "#ffd60a"
"""The object to be grasped: its pixels, its outline and its way."""
GRIPPER = "#00c8f0"
ARM = "#3c82ba"
GRASP = "#ff00ff"
"""The planned grasp."""
MARK = "#b8f53d"
"""Boxes and points that people draw."""
OUTLINE = "#10151b"
"""Around lines that lie over an image."""
AXES = ("#ff4646", "#46dc5a", "#508cff")
"""x, y and z of a frame, as other tools draw them."""
LABELS: Mapping[str, str] = {
    "background": "#2e3034",
    "floor": "#64686f",
    "table": "#e0d0c4",
    "arm": ARM,
    "gripper": GRIPPER,
    "target": TARGET,
}
"""By the names of ``Label``."""
OTHERS = ("#23a89a", "#871aa0", "#8fb657", "#fc94c2")
"""The objects other than the target, in turn."""

INK, PALE, PAPER, GRID = "#26282d", "#6b7078", "#f8f9fa", "#d9dce0"
"""Text, text that matters less, the ground of a sheet, and lines behind curves."""
DEPTH_MAP, FORCE_MAP = "viridis", "inferno"
"""Colour maps whose lightness rises evenly: near is dark and far is bright, 0 is black."""


def depth_colors() -> NDArray[np.uint8]:
    """Return the colours of depths from the nearest to the farthest, (256, 3) RGB."""
    return _colors(DEPTH_MAP)


def force_colors() -> NDArray[np.uint8]:
    """Return the colours of forces and pressures from 0 to the largest, (256, 3) RGB."""
    return _colors(FORCE_MAP)


def rgb(color: str) -> tuple[int, int, int]:
    """Return red, green and blue of a colour, 0 to 255."""
    return int(color[1:3], 16), int(color[3:5], 16), int(color[5:7], 16)


def hex_color(parts: Iterable[float]) -> str:
    """Return the colour of red, green and blue, whole numbers from 0 to 255."""
    red, green, blue = map(int, parts)
    return f"#{red:02x}{green:02x}{blue:02x}"


def _colors(name: str) -> NDArray[np.uint8]:
    import cv2  # noqa: PLC0415 (only pictures need it)

    steps = np.arange(256, dtype=np.uint8)[None]
    bgr = cv2.applyColorMap(steps, getattr(cv2, f"COLORMAP_{name.upper()}"))
    return np.asarray(bgr[0, :, ::-1], np.uint8)
