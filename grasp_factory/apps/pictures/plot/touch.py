"""Heat maps of both pads at a few moments."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Colormap, Normalize

from grasp_factory.apps.pictures.plot import style
from grasp_factory.apps.pictures.plot.style import SMALL, PageLayout, Rect
from grasp_factory.core import palette
from grasp_factory.core.geometry import Array
from grasp_factory.signals.plot_series import (
    PADS,
    Moment,
    Series,
    pad_forces,
    touch_was_measured,
)
from grasp_factory.signals.touch import center_of_pressure, taxel_image

COLUMNS = 6
"""Taxels of a heat map side by side; the number of rows makes taxels about square."""
TITLE, WORDS, TICKS, SCALE = 24, 36, 34, 62
"""Room for the heading, above a moment's maps, below them, and right of them."""
GAP, APART = 5, 16
"""Between the two pads of a moment, and between moments."""
LEFT = 42


def draw_touch(
    page: PageLayout,
    box: Rect,
    streams: Series,
    pad_size: tuple[float, float],
    moments: Sequence[Moment],
) -> None:
    """Draw the pads' heat maps at some moments into a box: left, top, width, height."""
    left, top, width, height = box
    page.text(left, top + 12, "touch: normal force on the pads", weight="bold")
    if not moments:
        felt = "nothing touched the pads" if touch_was_measured(streams) else "not measured"
        page.text(left, top + 40, felt, color=style.PALE)
        return
    rows = taxel_rows(pad_size)
    images = [_image(streams, pad_size, moment) for moment in moments]
    norm = Normalize(0.0, max(float(np.max(images)), 1e-9))
    colors = style.color_map(palette.force_colors(), "force")
    high = height - TITLE - WORDS - TICKS
    room = (width - LEFT - SCALE) / len(moments) - APART
    wide = min((room - GAP) / 2, high * pad_size[0] / pad_size[1])
    high = wide * pad_size[1] / pad_size[0]
    start, y = left + LEFT, top + TITLE + WORDS
    for letter, moment, image in zip("ABC", moments, images, strict=False):
        time = float(streams["timestamp"][moment.record])
        middle = start + wide + GAP / 2
        page.text(
            middle, y - 26, f"{letter}  {moment.name}, {time:.2f} s", size=SMALL, align="center"
        )
        forces = pad_forces({k: v[[moment.record]] for k, v in streams.items()})[0]
        for pad, word in enumerate(PADS):
            ax = page.axes(start + pad * (wide + GAP), y, wide, high)
            _draw_pad(ax, image[pad], norm, colors, pad_size)
            ax.set_title(f"{word} {forces[pad]:.1f} N", fontsize=SMALL, pad=3)
            place = _center(streams, moment)[pad] * 1e3
            ax.plot(*place, marker="+", color=style.CENTER, markersize=8, markeredgewidth=1.4)
            if moment is not moments[0] or pad:
                ax.set_yticklabels([])
            else:
                ax.set_ylabel("height on the pad, mm", fontsize=SMALL, labelpad=2)
        start += 2 * wide + GAP + APART
    legend = page.axes(start, y, 9, high)
    page.figure.colorbar(ScalarMappable(norm, colors), cax=legend)
    legend.tick_params(labelsize=SMALL, length=2, pad=2)
    legend.set_ylabel("N per taxel", fontsize=SMALL)
    page.text(
        left + LEFT, y + high + TICKS - 6,
        f"width, mm; {rows} x {COLUMNS} taxels; + centre of pressure; the fingertip is at the top",
        size=SMALL, color=style.PALE,
    )  # fmt: skip


def taxel_rows(pad_size: tuple[float, float]) -> int:
    """Return how many rows of taxels a pad of this width and height has."""
    return max(2, round(COLUMNS * pad_size[1] / pad_size[0]))


def _image(streams: Series, pad_size: tuple[float, float], moment: Moment) -> Array:
    """Return the taxels of both pads at one record, (2, rows, COLUMNS) newtons."""
    at = {name: values[[moment.record]] for name, values in streams.items()}
    return np.asarray(taxel_image(at, pad_size, taxel_rows(pad_size), COLUMNS)[0])


def _center(streams: Series, moment: Moment) -> Array:
    at = {name: values[[moment.record]] for name, values in streams.items()}
    return np.asarray(center_of_pressure(at)[0])


def _draw_pad(
    ax: Axes, image: Array, norm: Normalize, colors: Colormap, pad_size: tuple[float, float]
) -> None:
    half_width = 500.0 * pad_size[0] * COLUMNS / (COLUMNS - 1)  # the outer taxels' centres are
    half_height = 500.0 * pad_size[1] * len(image) / (len(image) - 1)  # on the pad's edges
    ax.imshow(
        image, origin="lower", cmap=colors, norm=norm, interpolation="nearest", aspect="auto",
        extent=(-half_width, half_width, -half_height, half_height),
    )  # fmt: skip
    tick = 5.0 if half_width > 7.0 else 1.0
    ax.set_xticks([-tick, 0.0, tick], [f"{-tick:.0f}", "0", f"{tick:.0f}"])
    ax.tick_params(labelsize=SMALL, length=2, pad=2)
    ax.set(xlim=(-half_width, half_width), ylim=(-half_height, half_height))
