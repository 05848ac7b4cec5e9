"""The shake after the hold: its levels and its motion."""

from __future__ import annotations

import itertools
from dataclasses import dataclass

from grasp_factory.core.serialization import check, check_range

STANDARD_GRAVITY = 9.80665
"""m/s2: the g of shake levels and of datasheets (ISO 80000-3)."""
STRONGEST_SHAKE = 3.0
"""Level beyond which the arm would not follow."""
SHORTEST_CYCLE = 4
"""Control periods that a motion of the shake takes at the least."""
SHAKE_MOTIONS = 4
"""Motions of each level of the shake: along three axes and about one."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ShakeConfig:
    """The disturbance after the hold.

    At each level the hand goes once to and fro along the world's three axes, then turns to and
    fro about its approach axis.
    """

    levels: tuple[float, ...] = (0.5, 1.0)
    """Peak accelerations in units of standard gravity, increasing; none for no shake.

    The arm follows to 2 % up to level 2 and no longer at 5 (IMU peaks down to 4.4).
    """
    cycle_s: float = 0.12
    """Seconds of one motion to and fro; it is shorter where a joint would be too slow."""
    lever: float = 0.10
    """Metres from the approach axis at which the turn's acceleration is that of the level."""

    def __post_init__(self) -> None:
        rising = all(a < b for a, b in itertools.pairwise((0.0, *self.levels)))
        check(rising, "levels", list(self.levels), "increasing numbers above 0")
        check(len(self.levels) <= 10, "levels", list(self.levels), "at most 10 levels")
        strongest = max(self.levels, default=0.0)
        check(strongest <= STRONGEST_SHAKE, "levels", list(self.levels), f"up to {STRONGEST_SHAKE}")
        check_range(self, "cycle_s", 0.05, 1.0, "s")
        check_range(self, "lever", 0.01, 1.0, "m")

    def longest_s(self, control_hz: int) -> float:
        """Return an upper bound for the time of all levels, seconds."""
        cycle = max(self.cycle_s, SHORTEST_CYCLE / control_hz)
        return len(self.levels) * SHAKE_MOTIONS * cycle
