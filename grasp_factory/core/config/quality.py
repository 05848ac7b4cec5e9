"""The config's section on quality: thresholds, and the score that an episode must have.

``labels/quality.py`` compares the measurements of an episode with the thresholds.
"""

from __future__ import annotations

from dataclasses import dataclass

from grasp_factory.core.serialization import check, check_range

BEST, WORST = 5, 1


@dataclass(frozen=True, slots=True, kw_only=True)
class QualityConfig:
    """The thresholds of the quality score, and the smallest score that an episode must have."""

    min_sharpness: float = 0.45
    """Sharpness of the least sharp image before the attempt.

    Sharpness is the share of the Laplacian's variance that a blur of 3 x 3 pixels removes.
    """
    min_exposure: float = 0.1
    """Smallest mean grey value, 0 black to 1 white, of any image before the attempt."""
    max_exposure: float = 0.9
    """Largest mean grey value of any image before the attempt."""
    max_clipped: float = 0.25
    """Largest share of black or white pixels in any image before the attempt."""
    min_visibility: float = 0.5
    """Smallest visible (not occluded) share of the target, in the camera that sees most of it."""
    min_target_pixels: int = 16
    """Smallest number of pixels of the target, in the image that has most of them."""
    max_depth_holes: float = 0.25
    """Largest share of pixels without depth in any depth image before the attempt."""
    max_stream_gap: float = 1.5
    """Longest time without a record in any time series, in periods of its rate."""
    max_penetration: float = 0.001
    """Largest penetration of a pad into the target and of the robot into the table, metres."""
    max_force_residual: float = 0.2
    """Largest difference between the hand's force on the target and the target's m (a - g).

    It is the mean over the hold, as a share of the target's weight.
    """
    min_score: int = WORST
    """Episodes with a lower score are quarantined; 1 accepts all."""

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
