"""The config's section on quality: thresholds, and the score that an episode must have.

``labels.quality`` compares the measurements of ``labels.image_metrics`` with the thresholds.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from grasp_factory.core.config.within import Within, check_within
from grasp_factory.core.serialization import check

BEST, WORST = 5, 1
QUALITY_WORDS = ("very poor", "poor", "fair", "good", "very good")
"""Of the scores, from the worst."""


def quality_text(score: int) -> str:
    """Return a score in words, such as ``4 of 5, good``; one that cannot be has no word."""
    word = f", {QUALITY_WORDS[score - WORST]}" if WORST <= score <= BEST else ""
    return f"{score} of {BEST}{word}"


@dataclass(frozen=True, slots=True, kw_only=True)
class QualityConfig:
    """The thresholds behind the quality score, and the score that an episode must have."""

    min_sharpness: Annotated[float, Within(0.0, 1.0)] = 0.45
    """Sharpness of the least sharp image before the attempt: the share of it that a blur of 3 x 3
    pixels takes.
    """
    min_exposure: Annotated[float, Within(0.0, 1.0)] = 0.1
    """Smallest mean grey value, 0 black to 1 white, of an image before the attempt."""
    max_exposure: Annotated[float, Within(0.0, 1.0)] = 0.9
    """Largest mean grey value of an image before the attempt."""
    max_clipped: Annotated[float, Within(0.0, 1.0)] = 0.25
    """Share of the pixels of an image before the attempt that are black or white."""
    min_visibility: Annotated[float, Within(0.0, 1.0)] = 0.5
    """Share of the target's pixels that nothing hides from the camera that sees it best."""
    min_target_pixels: Annotated[int, Within(0, 1_000_000)] = 16
    """Pixels of the target in the image that has most of them."""
    max_depth_holes: Annotated[float, Within(0.0, 1.0)] = 0.25
    """Share of the pixels of a depth image before the attempt that have no depth."""
    max_stream_gap: Annotated[float, Within(1.1, 1000.0, "periods")] = 1.5  # rounding exceeds 1
    """Longest time without a record in any of the series, in periods of its rate."""
    max_penetration: Annotated[float, Within(0.0, 1.0, "m")] = 0.001
    """Metres that a pad may sink into the target, and the robot into the table."""
    max_force_residual: Annotated[float, Within(0.0, 1000.0)] = 0.2
    """What forces and motion may leave unexplained in the hold, of the target's weight."""
    min_score: Annotated[int, Within(WORST, BEST)] = WORST
    """Episodes that score less are quarantined; 1 lets all of them in."""

    def __post_init__(self) -> None:
        check_within(self)
        valid = f"at most max_exposure ({self.max_exposure})"
        check(self.min_exposure <= self.max_exposure, "min_exposure", self.min_exposure, valid)
