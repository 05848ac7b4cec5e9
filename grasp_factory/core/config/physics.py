"""The config's section on physics: rates, the solver, gravity."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated

from grasp_factory.core.config.within import Within, check_within

FREE_RESIDUAL, CONTACT_RESIDUAL = 1e-6, 1e-7
"""``Stepping.residual`` before and from the first touch: 1 mm/s, then the engine's default."""


@dataclass(frozen=True, slots=True)
class Stepping:
    """Step rate and solver settings of the physics engine."""

    hz: int
    """Step rate, Hz."""
    iterations: int
    """Largest number of solver iterations over the constraints of a step."""
    motor_iterations: int
    """Iterations over the motors in each solver iteration."""
    residual: float
    """The solver stops when an iteration changes no velocity by more than its square root.

    The velocities are in m/s or rad/s.
    """


@dataclass(frozen=True, slots=True, kw_only=True)
class PhysicsConfig:
    """The simulator's rates and solver."""

    free_hz: Annotated[int, Within(60, 10_000, "Hz")] = 240
    """Step rate before the first touch, Hz: fall, transfer and approach."""
    contact_hz: Annotated[int, Within(120, 10_000, "Hz")] = 720
    """Step rate from the first touch on, Hz. docs/reference/physics.md compares other rates."""
    solver_iterations: Annotated[int, Within(1, 1000)] = 100
    """Largest number of solver iterations of a step before the first touch."""
    contact_iterations: Annotated[int, Within(1, 1000)] = 35
    """The same from the first touch on: shorter steps need fewer iterations."""
    motor_iterations: Annotated[int, Within(1, 100)] = 2
    """Iterations over the motors and the gear in each solver iteration of contact steps."""
    gravity: Annotated[float, Within(0.1, 30.0, "m/s2")] = 9.81
    """Acceleration of free fall, along -z, m/s2."""
    settle_s: Annotated[float, Within(0.1, 30.0, "s")] = 3.0
    """Longest time in which objects may come to rest, seconds."""

    @property
    def control_hz(self) -> int:
        """Control rate, Hz: motions begin and end at its periods; it divides both step rates."""
        return math.gcd(self.free_hz, self.contact_hz)

    @property
    def free(self) -> Stepping:
        """Stepping before the first touch."""
        return Stepping(self.free_hz, self.solver_iterations, 1, FREE_RESIDUAL)

    @property
    def contact(self) -> Stepping:
        """Stepping from the first touch on."""
        iterations = (self.contact_iterations, self.motor_iterations)
        return Stepping(self.contact_hz, *iterations, CONTACT_RESIDUAL)

    def __post_init__(self) -> None:
        check_within(self)


PHYSICS_PRESETS: Mapping[str, Mapping[str, int]] = {
    "default": {
        key: getattr(PhysicsConfig(), key)
        for key in ("contact_hz", "contact_iterations", "motor_iterations")
    },
    # With fewer iterations at this rate, the fingers do not reach the commanded force.
    "fast": {"contact_hz": 240, "contact_iterations": 50, "motor_iterations": 1},
}
"""Preset name to changed settings; docs/reference/physics.md has the cost of each preset."""
