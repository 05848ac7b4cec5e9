"""The config's section on the shake after the hold: its levels and its motion."""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from typing import Annotated

from grasp_factory.core.config.within import Valid, Within, check_within
from grasp_factory.core.serialization import check

STANDARD_GRAVITY = 9.80665
"""m/s2: the unit g of shake levels and of datasheets (ISO 80000-3)."""
STRONGEST_SHAKE = 3.0
"""Highest level; the arm cannot follow a stronger shake."""
MOST_LEVELS = 10
LEVELS = f"up to {MOST_LEVELS} increasing numbers above 0, up to {STRONGEST_SHAKE}"
SHORTEST_CYCLE = 4
"""Shortest duration of one motion of the shake, in control periods."""
SHAKE_MOTIONS = 4
"""Number of motions of each level: translation along three axes and rotation about one."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ShakeConfig:
    """The disturbance after the hold.

    At each level the hand moves back and forth once along each of the world's three axes, and then
    rotates back and forth once about its approach axis.
    """

    levels: Annotated[tuple[float, ...], Valid(LEVELS)] = (0.5, 1.0)
    """Peak accelerations in units of standard gravity, increasing; empty for no shake.

    The arm reaches the peak within 2 % up to level 2, but not at level 5 (IMU peaks down to 4.4).
    """
    cycle_s: Annotated[float, Within(0.05, 1.0, "s")] = 0.12
    """Duration of one motion back and forth, seconds; shorter where a joint would be too slow."""
    lever: Annotated[float, Within(0.01, 1.0, "m")] = 0.10
    """Distance from the approach axis where the rotation has the level's acceleration, metres."""

    def __post_init__(self) -> None:
        check_within(self)
        rising = all(a < b for a, b in itertools.pairwise((0.0, *self.levels)))
        check(rising, "levels", list(self.levels), "increasing numbers above 0")
        valid = f"at most {MOST_LEVELS} levels"
        check(len(self.levels) <= MOST_LEVELS, "levels", list(self.levels), valid)
        strongest = max(self.levels, default=0.0)
        check(strongest <= STRONGEST_SHAKE, "levels", list(self.levels), f"up to {STRONGEST_SHAKE}")

    def longest_s(self, control_hz: int) -> float:
        """Return an upper bound for the duration of all levels, seconds."""
        cycle = max(self.cycle_s, SHORTEST_CYCLE / control_hz)
        return len(self.levels) * SHAKE_MOTIONS * cycle
