"""Verifying a store: its metadata, its data other than rows, then the rows block by block."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from pathlib import Path

import numpy as np

from grasp_factory.core.executors import Executor, InlineExecutor, ProcessExecutor
from grasp_factory.core.object_storage.address import store_path
from grasp_factory.core.optional import require_pybullet
from grasp_factory.core.platforms import PARTS, differing, fingerprint_of, meaning, parsed
from grasp_factory.core.real_columns import Source
from grasp_factory.core.serialization import check, is_integer
from grasp_factory.core.text_format import count
from grasp_factory.curation.verify.annotation_log import annotation_problems
from grasp_factory.curation.verify.auxiliary_data import (
    embedded_problems,
    label_problems,
    packed_problems,
    rewritten_arrays,
    unknown_file_notes,
)
from grasp_factory.curation.verify.blocks import BlockChecker, Findings
from grasp_factory.curation.verify.deep import SEEDS, draw, new_seed, platform_notes, simulate_again
from grasp_factory.curation.verify.documents import group_faults, has_config, root_problem
from grasp_factory.curation.verify.foreign_chunks import rewritten_findings
from grasp_factory.curation.verify.partial_store import PartialStore, open_pieces
from grasp_factory.curation.verify.problems import Problem, VerifyReport
from grasp_factory.errors import StoreError
from grasp_factory.factory.run_request import MAX_EPISODES, MAX_WORKERS
from grasp_factory.writers.zarr.columns import Columns
from grasp_factory.writers.zarr.made_of_export import import_note
from grasp_factory.writers.zarr.made_with import changed_since
from grasp_factory.writers.zarr.writer import COMMITTED

BLOCKS_AT_ONCE = 16
"""Blocks that a worker gets at a time."""
FEW = 8
"""For up to this many blocks, no process is started."""


def verify(
    path: Path | str,
    deep: int = 0,
    workers: int = 1,
    *,
    deep_seed: int | None = None,
    on_start: Callable[[int], None] = lambda rows: None,
    on_episode: Callable[[int], None] = lambda row: None,
) -> VerifyReport:
    """Check everything in the store at ``path`` against its checksums and against itself.

    Nothing is changed. With more than one worker, call it under ``if __name__ == "__main__":``.

    Args:
        path: the store.
        deep: this many episodes, drawn at random, are simulated again and compared byte by byte.
        workers: number of processes; a small store is checked in this process.
        deep_seed: the seed with which they are drawn; None for another seed each time.
        on_start: called with the number of rows before the first is checked.
        on_episode: called with the number of each row, when it was checked or simulated.

    Raises:
        UsageError: if there is no store, for a number that is not valid, or if episodes are to be
            simulated and PyBullet is not installed, or code of the user that the
            episodes need was not given.
    """
    path = store_path(path)
    for key, got, low, high in (
        ("deep", deep, 0, MAX_EPISODES),
        ("workers", workers, 1, MAX_WORKERS),
        ("deep_seed", 0 if deep_seed is None else deep_seed, 0, SEEDS - 1),
    ):
        ok = is_integer(got) and low <= got <= high
        check(ok, key, got, f"an integer from {low} to {high}")
    if deep:
        require_pybullet()
    damaged = root_problem(path)
    if damaged and not has_config(path):
        return _unreadable(path, damaged)
    try:
        pieces, problems = open_pieces(path)
    except StoreError as error:
        return _unreadable(path, damaged or Problem(episode=None, array="", what=str(error)))
    if deep:
        from grasp_factory.factory.plugins import check_given  # noqa: PLC0415 - all policies

        check_given(pieces.config)
    problems = ([damaged] if damaged else []) + problems
    problems += structure_problems(pieces)
    on_start(pieces.rows + deep)
    found = check_blocks(pieces, range(pieces.blocks), workers, on_episode)
    problems += found.problems
    size = pieces.config.block_size
    broken = {problem.episode // size for problem in problems if problem.episode is not None}
    problems += packed_problems(pieces, broken)
    changed, notes = rewritten_findings(
        [*sorted(pieces.rewritten), *rewritten_arrays(pieces)], problems
    )
    problems += changed
    seed = new_seed() if deep_seed is None else deep_seed
    simulated = draw(_simulable(pieces, found), deep, seed) if deep else ()
    again = simulate_again(path, simulated, workers, on_episode)
    problems += [one.problem for one in again if one.problem]
    return VerifyReport(
        path=str(path),
        episodes=pieces.rows,
        committed=found.committed,
        quarantined=found.quarantined,
        missing=found.missing,
        problems=tuple(problems),
        notes=(
            *notes,
            *unknown_file_notes(pieces),
            *_of_platforms(pieces, found),
            *platform_notes(again),
            *filter(None, [import_note(pieces.attributes)]),
        ),
        changed=tuple(changed_since(pieces.attributes)),
        simulated=simulated,
        deep_seed=seed if deep else None,
    )


def structure_problems(pieces: PartialStore) -> list[Problem]:
    """Return the problems of groups, and of the store's data other than rows."""
    groups = group_faults(pieces.place, pieces.fields)
    out = [Problem(episode=None, array=name, what=fault) for name, fault in groups]
    for found in (embedded_problems, label_problems, annotation_problems):
        out += found(pieces)
    return out


def check_blocks(
    pieces: PartialStore, blocks: range, workers: int, on_episode: Callable[[int], None]
) -> Findings:
    """Check some blocks."""
    jobs = [
        blocks[first : first + BLOCKS_AT_ONCE] for first in range(0, len(blocks), BLOCKS_AT_ONCE)
    ]
    executor = executor_for(workers, len(blocks), few=FEW)
    return _joined(executor.run(BlockChecker(pieces.path), jobs, on_episode))


def executor_for(workers: int, tasks: int, few: int) -> Executor:
    """Return the executor for a number of tasks; up to ``few`` tasks run in this process."""
    return InlineExecutor() if workers == 1 or tasks <= few else ProcessExecutor(workers)


def _joined(several: Iterable[Findings]) -> Findings:
    out = Findings()
    for found in several:
        out.committed += found.committed
        out.quarantined += found.quarantined
        out.missing += found.missing
        out.problems += found.problems
        out.fingerprints += found.fingerprints
    return out


def _of_platforms(pieces: PartialStore, found: Findings) -> list[str]:
    """Return a note if rows come from other platforms than that of the store's fingerprint."""
    begun = fingerprint_of(pieces.attributes)
    others = {text: n for text, n in found.fingerprints.items() if begun and text != begun.text}
    if not begun or not others:
        return []
    known = [fingerprint for text in others if (fingerprint := parsed(text))]
    parts = [name for name in PARTS if any(name in differing(begun, other) for other in known)]
    rows = count(sum(others.values()), "row")
    return [f"{rows} of other platforms: the fingerprint differs from the store's in "
            f"{meaning(parts)}"]  # fmt: skip


def _simulable(pieces: PartialStore, found: Findings) -> list[int]:
    """Return the committed rows without a problem."""
    if len(pieces.arrays) < len(pieces.fields):
        return []
    columns = Columns(pieces.path, pieces.config, pieces.arrays)
    broken = {problem.episode for problem in found.problems}
    try:
        committed = np.flatnonzero(columns.read("status")["status"] == COMMITTED)
    except StoreError:
        return []
    return [row for row in committed.tolist() if row not in broken | _real_rows(columns)]


def _real_rows(columns: Columns) -> set[int]:
    """Return the rows of real episodes, which cannot be simulated."""
    if "source" not in columns.names:
        return set()
    return set(np.flatnonzero(columns.read("source")["source"] == Source.REAL).tolist())


def _unreadable(path: Path, problem: Problem) -> VerifyReport:
    return VerifyReport(
        path=str(path),
        episodes=0,
        committed=0,
        quarantined=0,
        missing=0,
        problems=(problem,),
        notes=(),
        changed=(),
    )
