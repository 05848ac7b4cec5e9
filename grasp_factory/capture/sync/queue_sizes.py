"""How many samples a live synchroniser must keep of each stream."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

from grasp_factory.core.serialization import check_range, normalise
from grasp_factory.errors import UsageError


@dataclass(frozen=True, slots=True, kw_only=True)
class StreamTiming:
    """How often a stream has samples, and how late they come."""

    rate_hz: float
    latency_s: float = 0.0
    """From the instant of a sample until it arrives, seconds; the longest that is usual."""

    def __post_init__(self) -> None:
        """Check the values.

        Raises:
            ConfigError: naming the value.
        """
        normalise(self)
        check_range(self, "rate_hz", 0.001, 100_000.0, "Hz")
        check_range(self, "latency_s", 0.0, 60.0, "s")


def queue_lengths(streams: Mapping[str, StreamTiming], margin: float = 1.5) -> dict[str, int]:
    """Return how many samples of each stream a synchroniser must keep, by name.

    A set can be formed when the slowest stream's sample has come, and the sample after it, which
    could be nearer. Until then a stream has ``rate (latency of the slowest - own latency + two
    periods of the slowest)`` new samples. ROS's examples use 10 or 30 for all streams: at 400 Hz
    and 120 ms the samples that belong to an image are gone when it comes.

    Args:
        streams: the streams, by name.
        margin: factor for latencies that vary.

    Raises:
        UsageError: without streams.
    """
    if not streams:
        raise UsageError("queue_lengths: no streams given, valid: 1 or more")
    latest = max(stream.latency_s for stream in streams.values())
    period = max(1.0 / stream.rate_hz for stream in streams.values())
    return {
        name: math.ceil(margin * stream.rate_hz * (latest - stream.latency_s + 2.0 * period)) + 2
        for name, stream in streams.items()
    }
