"""The quality score of an episode: criteria with thresholds, and the score from 1 to 5.

``image_metrics`` measures the values. Scores follow from columns alone, so that the scores of a
store can be computed again with other thresholds.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from grasp_factory.core.config.quality import BEST, WORST, QualityConfig

__all__ = [
    "BEST",
    "CRITERIA",
    "MEASURED",
    "WORST",
    "Criterion",
    "QualityConfig",
    "quality_scores",
    "shortcomings",
]


@dataclass(frozen=True, slots=True)
class Criterion:
    """A comparison of one column with one threshold."""

    group: str
    """The score loses one point for each group in which a criterion is not met."""
    column: str
    threshold: str
    """A field of the thresholds (``QualityConfig``): ``min_...`` or ``max_...``."""

    def is_met(self, values: ArrayLike, thresholds: object) -> NDArray[np.bool_]:
        """Return where the criterion is met, in the shape of ``values``; NaN meets it."""
        found, bound = np.asarray(values, np.float64), getattr(thresholds, self.threshold)
        missed = found < bound if self._is_least else found > bound
        return np.asarray(~missed)

    def text(self, value: float, thresholds: object) -> str:
        """Return the value found and the valid range."""
        word, bound = "least" if self._is_least else "most", getattr(thresholds, self.threshold)
        return f"{self.column} {value:.4g}, valid: at {word} {bound:g} ({self.threshold})"

    @property
    def _is_least(self) -> bool:
        return self.threshold.startswith("min_")


CRITERIA = (
    Criterion("image", "sharpness", "min_sharpness"),
    Criterion("image", "exposure", "min_exposure"),
    Criterion("image", "exposure", "max_exposure"),
    Criterion("image", "clipped", "max_clipped"),
    Criterion("target", "target_visibility", "min_visibility"),
    Criterion("target", "target_pixels", "min_target_pixels"),
    Criterion("depth", "depth_holes", "max_depth_holes"),
    Criterion("streams", "stream_gap", "max_stream_gap"),
    Criterion("physics", "max_penetration", "max_penetration"),
    Criterion("physics", "table_penetration", "max_penetration"),
    Criterion("physics", "force_residual", "max_force_residual"),
)

MEASURED = tuple(dict.fromkeys(criterion.column for criterion in CRITERIA))
"""The columns that a score depends on."""


def quality_scores(
    columns: Mapping[str, Any], thresholds: object, criteria: Sequence[Criterion] = CRITERIA
) -> NDArray[np.uint8]:
    """Return scores from 1 to 5: 5, minus 1 for each group with a criterion that is not met.

    Args:
        columns: Values by column, at least those of the criteria, all of one shape: (N,) for N
            episodes, () for one.
        thresholds: Bounds of the criteria, a ``QualityConfig`` for those of episodes.
        criteria: What is compared; by default what a simulated episode is judged by.
    """
    poor: dict[str, NDArray[np.bool_]] = {}
    for criterion in criteria:
        missed = ~criterion.is_met(columns[criterion.column], thresholds)
        poor[criterion.group] = poor.get(criterion.group, np.False_) | missed
    points = np.sum(list(poor.values()), axis=0)
    return np.asarray(np.maximum(BEST - points, WORST), np.uint8)


def shortcomings(
    columns: Mapping[str, Any], thresholds: object, criteria: Sequence[Criterion] = CRITERIA
) -> tuple[str, ...]:
    """Return a text for each criterion that one episode does not meet.

    Args:
        columns: Values by column, at least those of the criteria.
        thresholds: Bounds of the criteria.
        criteria: What is compared.
    """
    return tuple(
        criterion.text(float(columns[criterion.column]), thresholds)
        for criterion in criteria
        if not criterion.is_met(columns[criterion.column], thresholds)
    )
