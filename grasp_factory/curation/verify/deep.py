"""Simulating stored episodes again, to check whether the recipe still yields the stored bytes."""

from __future__ import annotations

import secrets
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from grasp_factory.core.executors import SendMessage
from grasp_factory.core.platforms import PARTS, meaning
from grasp_factory.curation import isolation
from grasp_factory.curation.verify.problems import Problem
from grasp_factory.errors import GraspFactoryError, StoreError

if TYPE_CHECKING:
    from grasp_factory.curation.replay import Replay

SEEDS = 2**32


def new_seed() -> int:
    """Return a random seed to draw episodes with; it is not part of any data."""
    return secrets.randbelow(SEEDS)


def draw(rows: list[int], count: int, seed: int) -> tuple[int, ...]:
    """Return ``count`` of these rows, or all if there are fewer, ascending."""
    rng = np.random.default_rng(seed)
    drawn = rng.choice(rows, size=min(count, len(rows)), replace=False) if rows else ()
    return tuple(sorted(int(row) for row in drawn))


@dataclass(frozen=True, slots=True, kw_only=True)
class Simulated:
    """The result of simulating a row again."""

    row: int
    same: bool
    differing: tuple[str, ...] = ()
    """Parts of the fingerprint in which the platform that made the row differs from this one."""
    problem: Problem | None = None


@dataclass(frozen=True, slots=True)
class Compared:
    """A row to simulate again."""

    row: int
    lost: str = ""
    """How the process has ended that tried it; empty if none has."""


def simulate_again(
    path: Path, rows: Sequence[int], workers: int, report: SendMessage
) -> list[Simulated]:
    """Simulate rows of a store again; see ``Simulator``."""
    if not rows:
        return []
    return isolation.isolated(min(workers, len(rows))).run(
        Simulator(path),
        [Compared(row) for row in rows],
        report,
        lambda job, why: replace(job, lost=why),
        isolation.patience,
    )


class Simulator:
    """Simulates rows of a store again, and reports the number of each that it has compared."""

    def __init__(self, path: Path) -> None:
        self._path = path

    def __reduce__(self) -> tuple[Any, ...]:
        return Simulator, (self._path,)

    def __call__(self, job: Compared, report: SendMessage) -> Simulated:
        """Compare the episode that a row's recipe yields with the stored one.

        Different bytes are a problem, unless the row's fingerprint differs from this platform's.
        """
        # Replaying loads the simulator, which the other checks do not need.
        from grasp_factory.curation.replay import replay_here  # noqa: PLC0415

        row = job.row
        try:
            if job.lost:
                raise StoreError(isolation.ended(job.lost))
            result = replay_here(self._path, row)
        except GraspFactoryError as error:
            problem = Problem(episode=row, array="", what=str(error))
            return Simulated(row=row, same=False, problem=problem)
        finally:
            report(row)
        is_excused = result.same or bool(result.differing)
        return Simulated(
            row=row,
            same=result.same,
            differing=result.differing,
            problem=None if is_excused else _problem(result),
        )


def platform_notes(found: Sequence[Simulated]) -> list[str]:
    """Return a note if rows that were simulated again come from another platform."""
    foreign = [one for one in found if one.differing]
    if not foreign:
        return []
    parts = [name for name in PARTS if any(name in one.differing for one in foreign)]
    others = ", ".join(str(one.row) for one in foreign if not one.same)
    differing = f"episodes that differ here, and are whole as stored: {others}"
    came = differing if others else "none differs here"
    return [
        f"{len(foreign)} of {len(found)} episodes simulated again were made on another platform:"
        f" the fingerprint differs in {meaning(parts)}; {came}"
    ]


def _problem(result: Replay) -> Problem:
    what = f"simulated again it differs: {result.difference or 'the reason of the quarantine'}"
    advice = "it is whole as stored; its recipe does not give it here and now"
    if result.changed:
        what += f"; not as when it was recorded: {', '.join(result.changed)}"
        advice = "it is whole as stored; compare where versions and platform are as recorded"
    elif result.fingerprint:
        what += "; fingerprint and versions are the recording's"
    array = result.difference.partition(":")[0].partition(" ")[0]
    return Problem(episode=result.index, array=array, what=what, advice=advice)
