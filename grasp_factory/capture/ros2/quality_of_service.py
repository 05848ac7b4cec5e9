"""How surely messages arrive: reliability, and how many are kept for a slow subscriber.

https://docs.ros.org/en/humble/Concepts/Intermediate/About-Quality-of-Service-Settings.html
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

from cyclonedds.core import Policy, Qos
from cyclonedds.util import duration

from grasp_factory.core.serialization import check_range, normalise

MOST_KEPT = 100_000
_LONGEST_BLOCK_S = 10.0
"""A publisher that keeps every message waits so long for a subscriber that takes none."""


class Reliability(Enum):
    """Whether a message that was lost is sent again."""

    RELIABLE = "reliable"
    BEST_EFFORT = "best-effort"


@dataclass(frozen=True, slots=True, kw_only=True)
class TopicQuality:
    """The quality of service of a publisher or a subscriber."""

    reliability: Reliability = Reliability.RELIABLE
    depth: int = 0
    """Messages that are kept until they are sent or taken. 0 keeps every one: a reliable publisher
    then waits for slow subscribers, and loses nothing."""
    is_latched: bool = False
    """Whether subscribers that come later get the last message, too (transient local)."""

    def __post_init__(self) -> None:
        normalise(self)
        check_range(self, "depth", 0, MOST_KEPT)

    def policies(self, more: str = "") -> Qos:
        """Return the settings for Cyclone DDS.

        Args:
            more: user data, such as ``typehash=...;``.
        """
        is_reliable = self.reliability is Reliability.RELIABLE
        found = [
            Policy.Reliability.Reliable(duration(seconds=_LONGEST_BLOCK_S))
            if is_reliable
            else Policy.Reliability.BestEffort,
            Policy.History.KeepLast(self.depth) if self.depth else Policy.History.KeepAll,
        ]
        if self.is_latched:
            last = Policy.History.KeepLast(1)
            found += [
                Policy.Durability.TransientLocal,
                Policy.DurabilityService(0, last, -1, -1, -1),
            ]
        if more:
            found.append(Policy.Userdata(more.encode()))
        return Qos(*found)
