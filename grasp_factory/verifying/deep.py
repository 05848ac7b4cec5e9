"""Simulating stored episodes again: does the recipe still give the stored bytes?"""

from __future__ import annotations

import secrets
from pathlib import Path
from typing import Any

import numpy as np

from grasp_factory.errors import GraspFactoryError
from grasp_factory.executors import Report
from grasp_factory.replay import replay
from grasp_factory.verifying.problems import Problem

SEEDS = 2**32


def new_seed() -> int:
    """Return a seed to draw episodes from; it is no part of any data."""
    return secrets.randbelow(SEEDS)


def draw(rows: list[int], count: int, seed: int) -> tuple[int, ...]:
    """Return ``count`` of these rows, or all if there are fewer, ascending."""
    rng = np.random.default_rng(seed)
    drawn = rng.choice(rows, size=min(count, len(rows)), replace=False) if rows else ()
    return tuple(sorted(int(row) for row in drawn))


class Simulator:
    """Simulates rows of a store again, and reports the number of each that it has compared."""

    def __init__(self, path: Path) -> None:
        self._path = path

    def __reduce__(self) -> tuple[Any, ...]:
        return Simulator, (self._path,)

    def __call__(self, row: int, report: Report) -> list[Problem]:
        """Return a problem if a row's recipe gives other bytes than are stored."""
        try:
            result = replay(self._path, row)
        except GraspFactoryError as error:
            return [Problem(episode=row, array="", what=str(error))]
        finally:
            report(row)
        if result.same:
            return []
        what = f"simulated again it differs: {result.difference or 'the reason of the quarantine'}"
        advice = "it is whole as stored; its recipe does not give it here and now"
        if result.changed:
            what += f"; not as when it was recorded: {', '.join(result.changed)}"
            advice = "it is whole as stored; compare where versions and platform are as recorded"
        array = result.difference.partition(":")[0].partition(" ")[0]
        return [Problem(episode=row, array=array, what=what, advice=advice)]
