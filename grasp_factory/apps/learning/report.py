"""The results of a training run, as JSON and as tables."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from grasp_factory.apps.learning.comparison import POPULATIONS, Comparison
from grasp_factory.apps.learning.scores import FIGURES, LEVEL, RESAMPLES, Estimate
from grasp_factory.core.serialization import to_plain

HEADINGS: Mapping[str, str] = {
    "auc": "AUC",
    "average_precision": "average precision",
    "accuracy": "accuracy",
    "calibration_error": "calibration error",
}


def report_of(comparison: Comparison, about: Mapping[str, Any]) -> dict[str, Any]:
    """Return a report as plain data: its sources, every score with its interval, and the fits.

    Args:
        comparison: The results.
        about: Stores, settings and other entries of the report.
    """
    populations = {
        name: {
            "what": POPULATIONS[name],
            "train_episodes": found.train_episodes,
            "test_episodes": len(found.success),
            "test_objects": found.objects,
            "test_success_rate": float(found.success.mean()),
            "scores": to_plain(found.scores),
        }
        for name, found in comparison.populations.items()
    }
    fitted = {
        kind: {
            "best_epoch": found.best_epoch,
            "val_loss": list(found.val_loss),
            "parameters": sum(p.numel() for p in found.model.network.parameters()),
        }
        for kind, found in comparison.trained.items()
    }
    intervals = f"{LEVEL:.0%}, {RESAMPLES} resamples of the test objects"
    return {
        **about,
        "intervals": intervals,
        "populations": populations,
        "gains": to_plain(comparison.gains),
        "fitted": fitted,
    }


def training_report_text(report: Mapping[str, Any]) -> str:
    """Return a report as text: a table for each population, and the gains."""
    lines = []
    for name, found in report["populations"].items():
        lines += [
            f"{name}: {found['what']}",
            f"learned from {found['train_episodes']} episodes; {found['test_episodes']} held out,"
            f" of {found['test_objects']} objects, {found['test_success_rate']:.1%} success",
            "",
            _row("", *(HEADINGS[figure] for figure in FIGURES)),
        ]
        for predictor, scores in found["scores"].items():
            lines.append(_row(predictor, *(estimate_text(scores[figure]) for figure in FIGURES)))
        lines.append("")
    for gain in report["gains"]:
        lines.append(
            f"AUC of {gain['of']} over {gain['over']} on {gain['population']}:"
            f" {estimate_text(gain['auc'], sign=True)}"
        )
    return "\n".join([*lines, f"in brackets: {report['intervals']}"])


def estimate_text(estimate: Estimate | Mapping[str, float], *, sign: bool = False) -> str:
    """Return an estimate as text, such as ``0.912 (0.897 to 0.926)``."""
    plain = to_plain(estimate)
    form = "+.3f" if sign else ".3f"
    value, low, high = (format(plain[key], form) for key in ("value", "low", "high"))
    return f"{value} ({low} to {high})"


def _row(first: str, *cells: str) -> str:
    return f"{first:<12}" + "".join(f"  {cell:<24}" for cell in cells).rstrip()
