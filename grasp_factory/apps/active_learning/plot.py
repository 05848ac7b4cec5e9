"""The picture of a flywheel: AUC against episodes, and the gain of active selection."""

from __future__ import annotations

import io
from collections.abc import Mapping, Sequence

import matplotlib as mpl
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from grasp_factory.apps.active_learning.rounds import Round, SelectionGain
from grasp_factory.apps.learning.scores import Estimate
from grasp_factory.core.palette import CURVES

COLORS: Mapping[str, str] = {"active": CURVES[1].light, "random": CURVES[0].light}
FIGURE = "auc"


def picture_of(arms: Mapping[str, Sequence[Round]], gains: Sequence[SelectionGain]) -> bytes:
    """Return the PNG of a flywheel's arms; two arms have a second panel with their difference."""
    panels = 2 if gains else 1
    with mpl.rc_context({"font.size": 10}):
        figure = Figure(figsize=(5.6 * panels, 4.6), layout="constrained")
        _draw_arms(figure.add_subplot(1, panels, 1), arms)
        if gains:
            _draw_gains(figure.add_subplot(1, panels, 2), gains)
        out = io.BytesIO()
        figure.savefig(out, format="png", dpi=120, metadata={"Software": None})
    return out.getvalue()


def _draw_arms(ax: Axes, arms: Mapping[str, Sequence[Round]]) -> None:
    for arm, turns in arms.items():
        episodes = [turn.episodes for turn in turns]
        value, low, high = _columns([turn.scores[FIGURE] for turn in turns])
        ax.plot(episodes, value, marker="o", color=COLORS[arm], label=arm)
        ax.fill_between(episodes, low, high, color=COLORS[arm], alpha=0.2, linewidth=0)
    _set(
        ax, "held-out objects", "AUC", [turn.episodes for turns in arms.values() for turn in turns]
    )
    ax.legend(loc="best", title="selection")


def _draw_gains(ax: Axes, gains: Sequence[SelectionGain]) -> None:
    episodes = [gain.episodes for gain in gains]
    value, low, high = _columns([gain.scores[FIGURE] for gain in gains])
    ax.axhline(0.0, color="0.6", linestyle="--", linewidth=1)
    ax.vlines(episodes, low, high, color="black")
    ax.plot(episodes, value, marker="o", linestyle="none", color="black")
    _set(ax, "active over random, paired", "gain in AUC", episodes)


def _columns(estimates: Sequence[Estimate]) -> tuple[list[float], list[float], list[float]]:
    return (
        [e.value for e in estimates],
        [e.low for e in estimates],
        [e.high for e in estimates],
    )


def _set(ax: Axes, title: str, ylabel: str, episodes: Sequence[int]) -> None:
    ax.set(title=title, xlabel="episodes learned from", ylabel=ylabel)
    ticks = sorted(set(episodes))
    ax.set_xticks(ticks, [str(tick) for tick in ticks])
    ax.grid(alpha=0.3)
