"""The config's section on quality: thresholds, and the score that an episode must have.

``labels.quality`` compares the measurements of ``labels.image_metrics`` with the thresholds.
"""

from __future__ import annotations

from dataclasses import dataclass

from grasp_factory.core.serialization import check, check_range

BEST, WORST = 5, 1


@dataclass(frozen=True, slots=True, kw_only=True)
class QualityConfig:
    """The thresholds behind the quality score, and the score that an episode must have."""

    min_sharpness: float = 0.45
    """Of the least sharp image before the attempt: what a blur of 3 x 3 pixels takes of it."""
    min_exposure: float = 0.1
    """Mean grey value, 0 black to 1 white, of the worst exposed image before the attempt."""
    max_exposure: float = 0.9
    max_clipped: float = 0.25
    """Share of the pixels of an image before the attempt that are black or white."""
    min_visibility: float = 0.5
    """Share of the target's pixels that nothing hides from the camera that sees it best."""
    min_target_pixels: int = 16
    """Pixels of the target in the image that has most of them."""
    max_depth_holes: float = 0.25
    """Share of the pixels of a depth image before the attempt that have no depth."""
    max_stream_gap: float = 1.5
    """Longest time without a record in any of the series, in periods of its rate."""
    max_penetration: float = 0.001
    """Metres that a pad may sink into the target, and the robot into the table."""
    max_force_residual: float = 0.2
    """What forces and motion may leave unexplained in the hold, of the target's weight."""
    min_score: int = WORST
    """Episodes that score less are quarantined; 1 lets all of them in."""

    def __post_init__(self) -> None:
        for key in ("sharpness", "exposure", "visibility"):
            check_range(self, f"min_{key}", 0.0, 1.0)
        for key in ("exposure", "clipped", "depth_holes"):
            check_range(self, f"max_{key}", 0.0, 1.0)
        valid = f"at most max_exposure ({self.max_exposure})"
        check(self.min_exposure <= self.max_exposure, "min_exposure", self.min_exposure, valid)
        check_range(self, "min_target_pixels", 0, 1_000_000)
        check_range(self, "max_stream_gap", 1.1, 1000.0, "periods")  # rounding exceeds 1
        check_range(self, "max_penetration", 0.0, 1.0, "m")
        check_range(self, "max_force_residual", 0.0, 1000.0)
        check_range(self, "min_score", WORST, BEST)
