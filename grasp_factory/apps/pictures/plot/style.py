"""The colours and the layout of a picture.

The lines have the colours of Okabe and Ito, and the phases have Tol's pale colours. Colour-blind
people can distinguish both.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cache

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.font_manager import FontProperties, findfont, get_font

Rect = tuple[float, float, float, float]
"""Left, top, width and height."""

BLACK, ORANGE, SKY, GREEN = "#000000", "#E69F00", "#56B4E9", "#009E73"
BLUE, RED, PURPLE = "#0072B2", "#D55E00", "#CC79A7"
LINES = (BLUE, RED, GREEN, ORANGE, PURPLE, SKY, BLACK)
"""Colours of a group's curves, in turn."""
PHASES = {
    "pregrasp": "#DDDDDD",
    "approach": "#BBCCEE",
    "close": "#CCDDAA",
    "lift": "#EEEEBB",
    "hold": "#CCEEFF",
    "shake": "#FFCCCC",
}
INK, PALE, GRID = "#262830", "#6b7078", "#d9dce0"
NOTHING = "#404246"
"""Colour of pixels where a depth image sees nothing."""
GRASP = "#ff00ff"

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
