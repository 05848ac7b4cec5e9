"""Simulating what a store says, in worker processes that a hostile store may end."""

from __future__ import annotations

from typing import Any

from grasp_factory.core.executors import Check, Executor, LimitedExecutor, ProcessLimits, go_on
from grasp_factory.core.executors.limited import SIMULATION
from grasp_factory.core.limits import MEMORY

SILENT_S = 120.0
"""Seconds after which a worker counts as stuck; its limit of CPU time ends it before."""


def isolated(
    workers: int = 1, check: Check = go_on, limits: ProcessLimits = SIMULATION
) -> Executor:
    """Return the executor for simulations and pictures that a store asks for."""
    return LimitedExecutor(workers, limits, check)


def patience(message: Any) -> float:
    """Return how long a worker may be silent; see ``executors.Silence``."""
    return SILENT_S


def ended(why: str) -> str:
    """Return the text for a simulation that has ended its process."""
    return f"the simulation ended its process ({why}); if memory was short: {MEMORY.advice}"
