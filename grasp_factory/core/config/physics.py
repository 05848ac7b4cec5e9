"""The config's section on physics: rates, the solver, gravity."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

from grasp_factory.core.serialization import check_range

FREE_RESIDUAL, CONTACT_RESIDUAL = 1e-6, 1e-7
"""While nothing is held, a millimetre per second is exact enough; then the engine's default."""


@dataclass(frozen=True, slots=True)
class Stepping:
    """How the engine advances time."""

    hz: int
    """Step rate."""
    iterations: int
    """Passes over a step's constraints, at the most."""
    motor_iterations: int
    """Passes over the motors in each of these."""
    residual: float
    """It is solved when a pass changes no velocity by more than the root of this, m/s or rad/s."""


@dataclass(frozen=True, slots=True, kw_only=True)
class PhysicsConfig:
    """The simulator's rates and solver."""

    free_hz: int = 240
    """Step rate while nothing is held: fall, transfer and approach."""
    contact_hz: int = 720
    """Step rate from the first touch on. docs/reference/physics.md compares other rates."""
    solver_iterations: int = 100
    """Passes over a step's constraints while nothing is held, at the most."""
    contact_iterations: int = 35
    """The same from the first touch on: shorter steps need fewer."""
    motor_iterations: int = 2
    """Passes over the motors and the gear in each of those."""
    gravity: float = 9.81
    """m/s2, along -z."""
    settle_s: float = 3.0
    """The longest time an object may take to come to rest, seconds."""

    @property
    def control_hz(self) -> int:
        """Rate at which motions begin and end, Hz: both kinds of step fit into it."""
        return math.gcd(self.free_hz, self.contact_hz)

    @property
    def free(self) -> Stepping:
        """How time advances while nothing is held."""
        return Stepping(self.free_hz, self.solver_iterations, 1, FREE_RESIDUAL)

    @property
    def contact(self) -> Stepping:
        """How time advances from the first touch on."""
        iterations = (self.contact_iterations, self.motor_iterations)
        return Stepping(self.contact_hz, *iterations, CONTACT_RESIDUAL)

    def __post_init__(self) -> None:
        check_range(self, "free_hz", 60, 10_000, "Hz")
        check_range(self, "contact_hz", 120, 10_000, "Hz")
        check_range(self, "solver_iterations", 1, 1000)
        check_range(self, "contact_iterations", 1, 1000)
        check_range(self, "motor_iterations", 1, 100)
        check_range(self, "gravity", 0.1, 30.0, "m/s2")
        check_range(self, "settle_s", 0.1, 30.0, "s")


PHYSICS_PRESETS: Mapping[str, Mapping[str, int]] = {
    "default": {
        key: getattr(PhysicsConfig(), key)
        for key in ("contact_hz", "contact_iterations", "motor_iterations")
    },
    # With fewer iterations, at this rate, the fingers do not reach the force they are told.
    "fast": {"contact_hz": 240, "contact_iterations": 50, "motor_iterations": 1},
}
"""By name: what differs from the default (docs/reference/physics.md has what it costs)."""
