"""The colours and the layout of a picture.

The colours are those of ``palette``; the phases are paler, because curves are drawn over them.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cache

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import ListedColormap
from matplotlib.figure import Figure
from matplotlib.font_manager import FontProperties, findfont, get_font
from numpy.typing import NDArray

from grasp_factory.core import palette

Rect = tuple[float, float, float, float]
"""Left, top, width and height."""

INK, PALE, GRID, NOTHING, GRASP = (
    palette.INK,
    palette.PALE,
    palette.GRID,
    palette.NOTHING,
    palette.GRASP,
)
CENTER = palette.GRIPPER
"""The centre of pressure, over the colours of forces."""
LINES = tuple(curve.light for curve in palette.CURVES)
"""Colours of a group's curves, in turn."""
_PALER = 0.72
"""Share of white in a phase's colour."""
PHASES = {
    name: palette.hex_color(
        np.rint(np.multiply(palette.rgb(paint.light), 1.0 - _PALER) + 255.0 * _PALER)
    )
    for name, paint in palette.PHASES.items()
}

DPI = 100
"""Dots per inch at which a picture's lengths are pixels."""
SMALL, NORMAL, LARGE = 8.0, 9.0, 14.0
"""Font sizes in points."""


@dataclass(frozen=True, slots=True)
class PageLayout:
    """A figure with positions in pixels from its upper left corner, before it is scaled."""

    figure: Figure
    width: float
    height: float

    def axes(self, left: float, top: float, width: float, height: float) -> Axes:
        """Return new axes in a box."""
        bottom = self.height - top - height
        box = (
            left / self.width,
            bottom / self.height,
            width / self.width,
            height / self.height,
        )
        return self.figure.add_axes(box)

    def text(
        self,
        left: float,
        top: float,
        words: str,
        *,
        color: str = INK,
        size: float = NORMAL,
        weight: str = "normal",
        align: str = "left",
        room: float = math.inf,
    ) -> None:
        """Write a line with its vertical middle at ``top``, shortened to at most ``room`` wide."""
        text = self.figure.text(
            left / self.width, 1.0 - top / self.height, drawable(words), color=color,
            fontsize=size, fontweight=weight, ha=align, va="center_baseline", parse_math=False,
        )  # fmt: skip
        letters, scale = text.get_text(), self.figure.bbox.width / self.width
        while letters and (width := text.get_window_extent().width / scale) > room:
            letters = letters[: min(len(letters) - 1, int(len(letters) * room / width))]
            text.set_text(f"{letters}...")


def drawable(text: str) -> str:
    """Return a text in which ``?`` replaces each character that the font lacks."""
    letters = _letters()
    return "".join(c if ord(c) in letters and c.isprintable() else "?" for c in text)


@cache
def _letters() -> frozenset[int]:
    return frozenset(get_font(findfont(FontProperties())).get_charmap())


def bare(ax: Axes) -> None:
    """Remove ticks and frame from axes."""
    ax.set_xticks([])
    ax.set_yticks([])
    for spine in ax.spines.values():
        spine.set_visible(False)


def color_map(colors: NDArray[np.uint8], name: str) -> ListedColormap:
    """Return a colour map of ``palette``, (n, 3) RGB."""
    return ListedColormap(colors / 255.0, name=name)
