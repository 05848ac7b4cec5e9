"""The card's bar charts, drawn with the same functions as the contact sheet.

OpenCV is a dependency already, and one version of it makes the same bytes on every machine. The
words in the charts are the package's own, which are ASCII.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from grasp_factory.apps.pictures.painting import (
    INK,
    PALE,
    PAPER,
    WHITE,
    BgrImage,
    bgr,
    outcome_color,
    put_text,
)
from grasp_factory.core import palette
from grasp_factory.core.config.label import LabelConfig
from grasp_factory.core.enums import Outcome
from grasp_factory.core.geometry import Array
from grasp_factory.core.shown_units import SHOWN_UNITS

WIDTH = 960
MARGIN, ROW, BAR = 20, 30, 18
_LABELS, _COUNTS = 170, 150
"""Pixels to the left and to the right of the bars."""
_PANEL = (300, 190)
_BINS = 30
_TOP = 99.0
"""Percentile of the values at which a histogram ends; larger values count in its last bin."""
_GOOD, _BAD = bgr(palette.SUCCESS.light), bgr(palette.FAILURES.light)


@dataclass(frozen=True, slots=True, kw_only=True)
class Measure:
    """A measurement behind the label."""

    column: str
    title: str
    """With the unit in which it is shown."""
    factor: float
    """Of a shown value to the stored one."""
    threshold: float | None
    """The value that success requires, in the shown unit; None if it requires none."""


def measures(label: LabelConfig) -> tuple[Measure, ...]:
    """Return the measurements that are drawn, with a label's thresholds."""
    return (
        _measure("lift_height", "lift height", label.min_lift),
        _measure("shake_level", "shake survived", label.min_shake or None),
        _measure("hold_duration", "hold duration", None),
        _measure("min_grip_force", "least grip force", label.min_grip_force or None),
        _measure("slip_distance", "slip in the hand", label.max_slip_distance),
        _measure("slip_angle", "turn in the hand", label.max_slip_angle),
    )


def _measure(column: str, words: str, stored: float | None) -> Measure:
    """Return a measurement and its threshold, which is given in the stored unit."""
    shown = SHOWN_UNITS[column]
    return Measure(
        column=column,
        title=f"{words}, {shown.unit.replace('°', 'degrees')}",
        factor=shown.factor,
        threshold=None if stored is None else shown.factor * stored,
    )


def outcomes_chart(outcomes: Mapping[str, int]) -> BgrImage:
    """Return a chart with a bar for each outcome; ``outcomes`` has their episodes."""
    total, most = sum(outcomes.values()), max(outcomes.values())
    image = _paper(2 * MARGIN + ROW * len(outcomes), WIDTH)
    room = WIDTH - 2 * MARGIN - _LABELS - _COUNTS
    for i, (word, episodes) in enumerate(outcomes.items()):
        y = MARGIN + ROW * i + ROW // 2
        left = MARGIN + _LABELS
        right = left + max(1, round(room * episodes / most))
        color = outcome_color(Outcome[word.upper()])
        put_text(image, word.replace("_", " "), (MARGIN, y))
        cv2.rectangle(image, (left, y - BAR // 2), (right, y + BAR // 2), color, cv2.FILLED)
        put_text(image, f"{episodes}  ({100 * episodes / total:.1f} %)", (right + 8, y), PALE)
    return image


def measures_chart(columns: Mapping[str, NDArray[Any]], label: LabelConfig) -> BgrImage:
    """Return a histogram of each measurement, with failures on top of successes.

    Args:
        columns: Values (n,) by column: ``success``, and measurements, NaN where there is none.
        label: The label whose thresholds are drawn.
    """
    drawn = [measure for measure in measures(label) if measure.column in columns]
    across = 3
    rows = -(-len(drawn) // across)
    width, height = _PANEL
    legend = 30
    image = _paper(legend + rows * height + MARGIN, WIDTH)
    x = MARGIN
    for word, color in (("success", _GOOD), ("failure", _BAD), ("asked for", INK)):
        cv2.rectangle(image, (x, 13), (x + 11, 24), color, cv2.FILLED)
        x += 18 + put_text(image, word, (x + 18, 19), INK) + 18
    for i, measure in enumerate(drawn):
        corner = (MARGIN + i % across * (width + 10), legend + i // across * height)
        panel = image[corner[1] : corner[1] + height, corner[0] : corner[0] + width]
        values = measure.factor * columns[measure.column]
        _draw_histogram(panel, measure, values, columns["success"])
    return image


def stacked_counts(
    values: Array, success: NDArray[np.bool_], edges: Array
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return the successes and failures of each bin, (len(edges) - 1,) each.

    Values outside the edges are counted in the nearest bin; NaN is not counted.
    """
    inside = np.clip(values, edges[0], edges[-1])
    good, bad = (np.histogram(inside[which], edges)[0] for which in (success, ~success))
    return good, bad


def bin_edges(values: Array) -> Array:
    """Return the edges of a histogram's bins, which contain all values except the largest few."""
    finite = values[np.isfinite(values)]
    low, high = float(finite.min()), float(np.percentile(finite, _TOP))
    largest = max(abs(low), abs(high))
    if high - low <= 1e-6 * largest + 1e-12:  # practically equal
        low, high = low - max(0.5, largest / 2), low + max(0.5, largest / 2)
    return np.linspace(low, high, _BINS + 1)


def _draw_histogram(
    panel: BgrImage, measure: Measure, values: Array, success: NDArray[np.bool_]
) -> None:
    height, width = panel.shape[:2]
    put_text(panel, measure.title, (0, 14), INK)
    if not np.isfinite(values).any():
        put_text(panel, "no attempt came that far", (0, height // 2), PALE)
        return
    seen = ~np.isnan(values)
    edges = bin_edges(values)
    good, bad = stacked_counts(values[seen], success[seen], edges)
    top, bottom = 30, height - 34
    unit = (bottom - top) / max(1, int((good + bad).max()))
    lefts = np.rint(np.linspace(0, width - 1, len(good) + 1)).astype(int)
    cv2.rectangle(panel, (0, top), (width - 1, bottom), WHITE, cv2.FILLED)
    for k, (n_good, n_bad) in enumerate(zip(good.tolist(), bad.tolist(), strict=True)):
        middle = bottom - _pixels(n_good * unit)
        end = bottom - _pixels((n_good + n_bad) * unit)
        for upper, lower, color in ((middle, bottom, _GOOD), (end, middle, _BAD)):
            if upper < lower:
                corners = (int(lefts[k]), upper), (int(lefts[k + 1]) - 1, lower - 1)
                cv2.rectangle(panel, *corners, color, cv2.FILLED)
    if measure.threshold is not None and edges[0] <= measure.threshold <= edges[-1]:
        share = (measure.threshold - edges[0]) / (edges[-1] - edges[0])
        x = round(share * (width - 1))
        cv2.line(panel, (x, top), (x, bottom), INK, 2)
    cv2.line(panel, (0, bottom), (width - 1, bottom), INK, 1)
    put_text(panel, f"{edges[0]:.3g}", (0, bottom + 14), PALE, 11)
    beyond = " and more" if np.nanmax(values) > edges[-1] else ""
    _put_right(panel, f"{edges[-1]:.3g}{beyond}", (width - 1, bottom + 14))
    _put_right(panel, f"highest bin: {int((good + bad).max())}", (width - 1, 14))


def _pixels(length: float) -> int:
    """Return a bar's length in pixels, at least one for a count above 0."""
    return max(1, round(length)) if length > 0.0 else 0


def _put_right(image: BgrImage, text: str, at: tuple[int, int]) -> None:
    scratch = np.zeros_like(image)
    put_text(image, text, (at[0] - put_text(scratch, text, (0, at[1]), PALE, 11), at[1]), PALE, 11)


def _paper(height: int, width: int) -> BgrImage:
    return np.full((height, width, 3), PAPER, np.uint8)
