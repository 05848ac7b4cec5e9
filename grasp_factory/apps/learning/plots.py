"""Plots of the results: ROC, calibration, learning curve."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from sklearn.metrics import roc_curve

from grasp_factory.apps.learning.comparison import Population
from grasp_factory.apps.learning.report import estimate_text
from grasp_factory.apps.learning.scores import Estimate
from grasp_factory.core.palette import CURVES

COLORS: Mapping[str, str] = {
    name: paint.light
    for name, paint in zip(
        ("vision", "pose", "both", "touch", "vision_lifts"), CURVES, strict=False
    )
} | {"majority": CURVES[-1].light}
BINS = 10
"""Number of bins in the calibration plot; all have the same number of episodes."""


def plot_roc(path: Path, populations: Mapping[str, Population]) -> None:
    """Draw the ROC of every predictor, with one panel for each population."""
    with _figure(path, len(populations)) as axes:
        for ax, (name, found) in zip(axes, populations.items(), strict=True):
            for predictor, p in found.probabilities.items():
                false, true, _ = roc_curve(found.success, p)
                auc = estimate_text(found.scores[predictor]["auc"])
                ax.plot(false, true, color=COLORS[predictor], label=f"{predictor}: {auc}")
            ax.set(title=name, xlabel="false positive rate", ylabel="true positive rate")
            ax.set_aspect("equal")
            ax.legend(loc="lower right", title="AUC", fontsize=8)


def plot_calibration(path: Path, populations: Mapping[str, Population]) -> None:
    """Draw the share of grasps that held against their predicted probability."""
    with _figure(path, len(populations)) as axes:
        for ax, (name, found) in zip(axes, populations.items(), strict=True):
            ax.plot([0, 1], [0, 1], color="0.8", linestyle="--")
            for predictor, p in found.probabilities.items():
                order = np.array_split(np.argsort(p, kind="stable"), BINS)
                said = [p[rows].mean() for rows in order if len(rows)]
                held = [found.success[rows].mean() for rows in order if len(rows)]
                error = estimate_text(found.scores[predictor]["calibration_error"])
                label = f"{predictor}: {error}"
                ax.plot(said, held, marker="o", color=COLORS[predictor], label=label)
            ax.set(title=name, xlabel="predicted probability", ylabel="share that held")
            ax.set_aspect("equal")
            ax.legend(loc="upper left", title="calibration error", fontsize=8)


def plot_curve(
    path: Path, sizes: Sequence[int], curves: Mapping[str, Sequence[Estimate]], test: str
) -> None:
    """Draw AUC against the number of training episodes.

    Args:
        path: File of the picture.
        sizes: Numbers of episodes.
        curves: AUC at each size, by predictor.
        test: Title of the plot: what the AUC was measured on.
    """
    with _figure(path, 1) as (ax,):
        for predictor, auc in curves.items():
            value, low, high = (
                [getattr(e, part) for e in auc] for part in ("value", "low", "high")
            )
            ax.plot(sizes, value, marker="o", color=COLORS[predictor], label=predictor)
            ax.fill_between(sizes, low, high, color=COLORS[predictor], alpha=0.2, linewidth=0)
        ax.set(
            xscale="log", xlabel="training episodes", ylabel="AUC on held-out objects", title=test
        )
        ax.set_xticks(sizes, [str(size) for size in sizes])
        ax.minorticks_off()
        ax.grid(alpha=0.3)
        ax.legend(loc="lower right")


@contextmanager
def _figure(path: Path, columns: int) -> Iterator[Sequence[Axes]]:
    """Yield axes side by side, one for each column, and write the PNG afterwards."""
    with mpl.rc_context({"font.size": 10}):
        figure = Figure(figsize=(5.6 * columns, 5.0), layout="constrained")
        yield [figure.add_subplot(1, columns, i + 1) for i in range(columns)]
        figure.savefig(path, dpi=120, metadata={"Software": None})
