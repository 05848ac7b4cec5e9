"""Curves in a column over one time axis, with the phases behind them and marked moments."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import cycle

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import MaxNLocator

from grasp_factory.apps.pictures.plot import style
from grasp_factory.apps.pictures.plot.style import NORMAL, SMALL, PageLayout, Rect
from grasp_factory.core import palette
from grasp_factory.core.episode import Episode
from grasp_factory.core.geometry import Array
from grasp_factory.core.shown_units import SHOWN_UNITS
from grasp_factory.signals.plot_series import (
    CurveGroup,
    Moment,
    PhaseSpan,
    in_shown_unit,
    phase_spans,
)

SHOWN = (
    *("joint_positions", "gripper_width", "pad_force", "object_height", "wrist_force"),
    *("wrist_torque", "imu_specific_force", "imu_angular_velocity"),
)
"""Groups that are drawn, from the top."""
FROM_ZERO = ("gripper_width", "pad_force", "object_height")
"""Groups whose axis includes 0, because small changes far from 0 do not matter."""
UNITS = {"m/s2": "m/s²", "N m": "N·m"}
MARKS, BAR, TITLE, TICKS = 34, 18, 24, 34
"""Heights of the marks' words, the phases' bar, a panel's title, and the time axis' numbers."""
UNITS_LEFT = 52
"""Distance of the units from their axis, to the left."""
LETTER = 6.6
"""Approximate width of a small letter, pixels."""


@dataclass(frozen=True, slots=True, kw_only=True)
class TimeMark:
    """A vertical line through all curves."""

    time: float
    word: str
    color: str
    style: str


def is_drawn(groups: Iterable[CurveGroup]) -> bool:
    """Return whether any group is drawn."""
    return any(group.key in SHOWN for group in groups)


def draw_curves(
    page: PageLayout,
    box: Rect,
    episode: Episode,
    groups: Iterable[CurveGroup],
    moments: Sequence[Moment],
) -> None:
    """Draw an attempt with at least one record into a box: left, top, width, height."""
    left, top, width, height = box
    phases = [p for p in phase_spans(episode.streams) if np.isfinite([p.start, p.end]).all()]
    shown = sorted(
        (group for group in groups if group.key in SHOWN), key=lambda g: SHOWN.index(g.key)
    )
    clocks = {"streams": episode.streams["timestamp"], "imu": episode.imu.get("timestamp")}
    limits = _limits([times for times in clocks.values() if times is not None])
    marks = _marks(episode, moments)
    _draw_bar(page, (left, top, width, MARKS + BAR), limits, phases, marks)
    first = top + MARKS + BAR
    step = (height - MARKS - BAR - TICKS) / len(shown)
    for i, group in enumerate(shown):
        ax = page.axes(left, first + i * step + TITLE, width, step - TITLE)
        times = clocks[group.clock]
        assert times is not None
        _draw_group(ax, group, times, _wanted(episode, group.key))
        for phase in phases:
            ax.axvspan(phase.start, phase.end, color=_color(phase), alpha=0.35, lw=0, zorder=0)
        for mark in marks:
            ax.axvline(mark.time, color=mark.color, linestyle=mark.style, lw=0.9, zorder=1.5)
        ax.set_xlim(*limits)
        ax.yaxis.set_label_coords(-UNITS_LEFT / width, 0.5)
        ax.xaxis.set_major_locator(MaxNLocator(nbins=10, steps=[1, 2, 5, 10]))
        is_last = i == len(shown) - 1
        ax.tick_params(labelbottom=is_last, labelsize=SMALL, length=3, width=0.6)
        if is_last:
            start = "the episode began" if episode.is_real else "the arm started"
            ax.set_xlabel(f"time since {start}, s", fontsize=NORMAL, labelpad=3)


def _draw_group(ax: Axes, group: CurveGroup, times: Array, wanted: float | None) -> None:
    factor = SHOWN_UNITS[group.key].factor if group.key in SHOWN_UNITS else 1.0
    group = in_shown_unit(group)
    marker = "." if len(times) < 3 else ""
    for name, values, color in zip(group.names, group.values.T, cycle(style.LINES), strict=False):
        is_target = name == "target"
        ax.plot(
            times, values, label=name, marker=marker,
            color=style.INK if is_target else color, linestyle="--" if is_target else "-",
            linewidth=0.9 if is_target else 1.2,
        )  # fmt: skip
    if wanted:
        ax.axhline(
            factor * wanted,
            color=style.INK,
            linestyle=":",
            linewidth=1.0,
            label="asked for success",
        )
    ax.set_title(group.title, loc="left", fontsize=NORMAL, fontweight="bold", pad=4)
    ax.set_ylabel(UNITS.get(group.units, group.units), fontsize=NORMAL)
    ax.yaxis.set_major_locator(MaxNLocator(nbins=4, min_n_ticks=2))
    ax.margins(y=0.08)
    ax.ticklabel_format(axis="y", useOffset=False)
    if group.key in FROM_ZERO:
        ax.update_datalim([(times[0], 0.0)], updatex=False)
        ax.autoscale_view(scalex=False)
    ax.grid(color=style.GRID, linewidth=0.5)
    ax.set_axisbelow(True)
    for side in ("top", "right"):
        ax.spines[side].set_visible(False)
    if len(ax.lines) > 1:
        ax.legend(
            loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=len(ax.lines), frameon=False,
            fontsize=SMALL, borderaxespad=0.1, borderpad=0.1, handlelength=1.3,
            handletextpad=0.4, columnspacing=1.0,
        )  # fmt: skip


def _draw_bar(
    page: PageLayout,
    box: Rect,
    limits: tuple[float, float],
    phases: Sequence[PhaseSpan],
    marks: Sequence[TimeMark],
) -> None:
    """Draw the phases as a bar with their names, and the marks' words above it."""
    left, top, width, height = box
    ax = page.axes(left, top, width, height)
    style.bare(ax)
    ax.patch.set_visible(False)
    ax.set(xlim=limits, ylim=(height, 0))
    scale = width / (limits[1] - limits[0])
    middle = MARKS + BAR / 2
    for phase in phases:
        start, end = phase.start, phase.end
        ax.fill_between([start, end], MARKS, height, color=_color(phase), linewidth=0)
        name = _fitting(phase.name, (end - start) * scale)
        ax.text(
            (start + end) / 2, middle, name, ha="center", va="center_baseline", fontsize=SMALL,
            clip_on=True,
        )  # fmt: skip
    ends = [-np.inf, -np.inf]
    for mark in marks:
        at = (mark.time - limits[0]) * scale
        half = LETTER * len(mark.word) / 2 + 3
        row = next((k for k, end in enumerate(ends) if at - half >= end), 0)
        ends[row] = at + half
        y = MARKS - 9 - 15 * row
        ax.plot([mark.time] * 2, [y + 6, height], color=mark.color, linestyle=mark.style, lw=0.9)
        ax.text(
            mark.time, y, mark.word, color=mark.color, ha="center", va="center_baseline",
            fontsize=SMALL, fontweight="bold",
        )  # fmt: skip


def _marks(episode: Episode, moments: Sequence[Moment]) -> list[TimeMark]:
    times = episode.streams["timestamp"]
    marks = [
        TimeMark(time=float(times[moment.record]), word=letter, color=style.PALE, style="-")
        for letter, moment in zip("ABC", moments, strict=False)
    ]
    loss = float(episode.columns.get("loss_time", np.nan))
    if np.isfinite(loss):
        color = palette.OUTCOMES["lost_in_hold"].light
        marks.append(TimeMark(time=loss, word="lost", color=color, style="--"))
    return sorted((mark for mark in marks if np.isfinite(mark.time)), key=lambda mark: mark.time)


def _wanted(episode: Episode, key: str) -> float | None:
    """Return the value that success requires of a group; None if it requires none."""
    label = episode.spec.label
    return {"object_height": label.min_lift, "pad_force": label.min_grip_force}.get(key)


def _limits(clocks: Sequence[Array]) -> tuple[float, float]:
    """Return the first and the last time of the axis, s; they always differ."""
    times = np.concatenate(clocks)
    times = times[np.isfinite(times)]
    if not len(times):
        return 0.0, 1.0
    low, high = min(0.0, float(times.min())), float(times.max())
    return low, max(high, low + 1e-3)


def _fitting(word: str, width: float) -> str:
    """Return a word, shortened if it is wider than ``width``."""
    room = int(width / LETTER)
    return word if len(word) <= room else f"{word[: room - 1]}." if room > 1 else ""


def _color(phase: PhaseSpan) -> str:
    return style.PHASES.get(phase.name, "white")
