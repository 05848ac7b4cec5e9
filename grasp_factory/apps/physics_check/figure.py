"""One measured figure with its bounds."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True, slots=True, kw_only=True)
class Figure:
    """The result of a check."""

    check: str
    figure: str
    """What the value is: median, 95th percentile, ..."""
    value: float
    unit: str
    low: float
    """Smallest value that passes; ``-inf`` for no bound."""
    high: float
    """Largest value that passes; ``inf`` for no bound."""
    samples: int

    @property
    def passes(self) -> bool:
        """Whether the value is within its bounds; False if there is no sample."""
        return bool(self.samples > 0 and self.low <= self.value <= self.high)

    @property
    def bound(self) -> str:
        """The bounds as text."""
        if self.low == -np.inf:
            return f"<= {self.high:g} {self.unit}"
        if self.high == np.inf:
            return f">= {self.low:g} {self.unit}"
        return f"{self.low:g} to {self.high:g} {self.unit}"


def at_most(
    check: str, figure: str, value: float, bound: float, *, unit: str = "", samples: int = 1
) -> Figure:
    """Return a figure that must not exceed ``bound``."""
    return Figure(check=check, figure=figure, value=float(value), unit=unit, low=-np.inf,
                  high=bound, samples=samples)  # fmt: skip


def percentiles(
    check: str, values: Iterable[float], bounds: dict[int, float], *, unit: str = "%"
) -> list[Figure]:
    """Return percentiles of values, each with the bound that it must not exceed."""
    found = np.asarray(list(values), np.float64)
    figures = []
    for rank, bound in bounds.items():
        name = "median" if rank == 50 else f"{rank}th percentile"
        value = float(np.percentile(found, rank)) if len(found) else np.nan
        figures.append(at_most(check, name, value, bound, unit=unit, samples=len(found)))
    return figures
