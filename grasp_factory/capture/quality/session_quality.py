"""The quality score of a recorded session or episode: criteria, thresholds, and the score.

It is the same scheme as ``labels.quality`` has for simulated episodes.
"""

from __future__ import annotations

from dataclasses import dataclass

from grasp_factory.core.config.quality import BEST, WORST
from grasp_factory.core.serialization import check, check_range, to_plain
from grasp_factory.labels.quality import Criterion, quality_scores, shortcomings


@dataclass(frozen=True, slots=True, kw_only=True)
class SessionQualityConfig:
    """The thresholds behind the score, and the score that an episode must have."""

    min_sharpness: float = 0.3
    """Median of the images of the least sharp camera: what a mean over 3 x 3 pixels takes of the
    edges, without noise. A Gaussian blur of 1.6 pixels (standard deviation) leaves 0.3."""
    min_exposure: float = 0.1
    """Median of the mean grey value, 0 black to 1 white, of the worst exposed camera."""
    max_exposure: float = 0.9
    max_clipped: float = 0.25
    """Median share of pixels that are black or white."""
    max_frozen: int = 3
    """Longest run of images that repeat the one before them bit by bit."""
    max_stream_gap: float = 3.0
    """Longest time without a sample in any stream, in periods of its rate."""
    max_lost: float = 0.01
    """Share of the samples of a stream that were made and not recorded."""
    max_imu_noise: float = 3.0
    """White noise of the IMU at rest, as a multiple of its calibration."""
    max_saturated: float = 0.001
    """Share of the samples of a force-torque sensor or IMU at the end of its range."""
    max_sync_spread: float = 0.001
    """Seconds by which 99 % of the images are farther from the nearest sample of another stream
    than half of its period: the visual-inertial tolerance is 1 ms."""
    min_score: int = WORST
    """Episodes that score less are not imported; 1 lets all of them in."""

    def __post_init__(self) -> None:
        for key in ("min_sharpness", "min_exposure", "max_exposure", "max_clipped", "max_lost"):
            check_range(self, key, 0.0, 1.0)
        valid = f"at most max_exposure ({self.max_exposure})"
        check(self.min_exposure <= self.max_exposure, "min_exposure", self.min_exposure, valid)
        check_range(self, "max_frozen", 0, 1_000_000, "images")
        check_range(self, "max_stream_gap", 1.1, 1e6, "periods")
        check_range(self, "max_imu_noise", 1.0, 1e6)
        check_range(self, "max_saturated", 0.0, 1.0)
        check_range(self, "max_sync_spread", 0.0, 1e6, "s")
        check_range(self, "min_score", WORST, BEST)


@dataclass(frozen=True, slots=True, kw_only=True)
class SessionInspection:
    """Quality measurements of a session or a part of it; NaN where a stream is missing.

    The fields of ``SessionQualityConfig`` say what each is.
    """

    sharpness: float
    exposure: float
    clipped: float
    frozen: float
    stream_gap: float
    lost: float
    accelerometer_noise: float
    """NaN without a calibration or without a time at rest."""
    gyroscope_noise: float
    saturated: float
    sync_spread: float

    def score(self, thresholds: SessionQualityConfig) -> int:
        """Return the score from 1 to 5: 5, minus 1 for each group with a missed criterion."""
        return int(quality_scores(to_plain(self), thresholds, SESSION_CRITERIA))

    def shortcomings(self, thresholds: SessionQualityConfig) -> tuple[str, ...]:
        """Return a text for each criterion that is not met."""
        return shortcomings(to_plain(self), thresholds, SESSION_CRITERIA)


SESSION_CRITERIA = (
    Criterion("image", "sharpness", "min_sharpness"),
    Criterion("image", "exposure", "min_exposure"),
    Criterion("image", "exposure", "max_exposure"),
    Criterion("image", "clipped", "max_clipped"),
    Criterion("frozen", "frozen", "max_frozen"),
    Criterion("streams", "stream_gap", "max_stream_gap"),
    Criterion("streams", "lost", "max_lost"),
    Criterion("sensors", "accelerometer_noise", "max_imu_noise"),
    Criterion("sensors", "gyroscope_noise", "max_imu_noise"),
    Criterion("sensors", "saturated", "max_saturated"),
    Criterion("sync", "sync_spread", "max_sync_spread"),
)
