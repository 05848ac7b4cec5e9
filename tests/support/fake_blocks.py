"""Block functions that spawned workers can import: what a block may do to its worker."""

from __future__ import annotations

import os
import signal
import sqlite3
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from grasp_factory.core.executors import ProcessExecutor
from grasp_factory.errors import RecipeError

Report = Callable[[Any], None]


class Unpicklable(Exception):
    """An error that cannot be rebuilt from its arguments."""

    def __init__(self, a: str, b: str) -> None:
        super().__init__(a)


def square(block: int, report: Report) -> int:
    for step in range(3):
        report((block, step))
    return block * block


def squares_in_workers() -> list[int]:
    return ProcessExecutor(1).run(square, [3, 4], lambda _: None)


def process_id(block: int, report: Report) -> int:
    return os.getpid()


def chatty(block: int, report: Report) -> int:
    for step in range(5_000):
        report((block, step, "x" * 200))
    return block


def noisy(block: int, report: Report) -> int:
    os.write(1, b"a warning of the physics library\n")
    return block


def environment(block: int, report: Report) -> tuple[str | None, str | None]:
    return os.environ.get("OMP_NUM_THREADS"), os.environ.get("OPENBLAS_NUM_THREADS")


def user_error(block: int, report: Report) -> int:
    raise RecipeError(f"block {block} is impossible")


def strange_error(block: int, report: Report) -> int:
    raise Unpicklable("lost", "in transit")


def exit_early(block: int, report: Report) -> int:
    raise SystemExit(7)


def dies_in_block_two(block: int, report: Report) -> int:
    report(block)
    if block == 2:
        os.kill(os.getpid(), signal.SIGKILL)
    time.sleep(0.05)
    return block


def naps(block: int, report: Report) -> int:
    report(os.getpid())
    time.sleep(0.3)
    return block


HEARD: list[Any] = []
"""Messages that the calling process heard of ``first_waits_for_others``."""


def first_waits_for_others(block: int, report: Report) -> int:
    if block:
        report(block)
    else:
        while not {1, 2, 3} <= set(HEARD):
            report(0)
            time.sleep(0.01)
    return os.getpid()


def sleeps(block: int, report: Report) -> int:
    report(os.getpid())
    time.sleep(600)
    return block


def queries(block: int, report: Report) -> int:
    """Ask SQLite for ever: its C code does not return to Python for signals."""
    endless = "WITH RECURSIVE c(x) AS (SELECT 1 UNION ALL SELECT x FROM c) SELECT x FROM c"
    sqlite3.connect(":memory:").execute(f"{endless} WHERE x = 2").fetchall()
    return block


def stops(block: int, report: Report) -> int:
    if block == 1:
        report("stops")
        os.kill(os.getpid(), signal.SIGSTOP)
    return block


def tidies(block: int, report: Report, folder: str) -> int:
    mark = Path(folder) / "scratch"
    mark.touch()
    try:
        report(os.getpid())
        time.sleep(600)
    finally:
        mark.unlink()
    return block
