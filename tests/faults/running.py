"""One fault in a copy of the repository, and what the tests say of it."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path

from faults.fault import PACKAGE, Fault

LEFT_OUT = shutil.ignore_patterns(".*", "*.egg-info")
LIMIT_S = 3600.0
"""Of one run of pytest; each test has a limit of its own (setup.cfg)."""
_FAILED = re.compile(r"^(?:FAILED|ERROR) (\S+::.+?)(?: - .*)?$", re.MULTILINE)
_OF_EARLY_IMPORTS = "pytest.PytestAssertRewriteWarning"
"""Libraries that are plugins of pytest, too, are imported before it."""
PASSED, SOME_FAILED = 0, 1
"""Exit codes of pytest; all others say that it could not run the tests."""


class Verdict(StrEnum):
    """What came of a fault."""

    CAUGHT = "caught"
    """A test fails with the fault."""
    NOT_CAUGHT = "not caught"
    BROKEN = "broken"
    """The changed module does not import, or pytest cannot run: no fair fault."""
    UNSOUND = "unsound"
    """That test fails without it, too (``failing_anyway``)."""


class Width(StrEnum):
    """Which tests are run, the narrowest first."""

    NAMED = "named"
    """Those that the table names."""
    ROOM = "room"
    """All of the room that the changed file is in."""
    ALL = "all"

    def tests(self, fault: Fault) -> list[str]:
        """Return the paths to run, below the repository."""
        if self is Width.ALL:
            return ["tests"]
        below = fault.tests if self is Width.NAMED else (fault.room,)
        return [f"tests/{path}" for path in below]


@dataclass(frozen=True, slots=True, kw_only=True)
class Result:
    """What the tests say of one fault."""

    name: str
    file: str
    verdict: Verdict
    width: Width
    """The tests that caught it, or the widest that did not."""
    test: str = ""
    """The first test that fails, or what is wrong with the fault."""
    seconds: float = 0.0


def try_fault(fault: Fault, repository: Path, widest: Width, marker: str) -> Result:
    """Seed a fault in a copy and run tests until one catches it, the narrowest set first.

    Args:
        fault: What to seed.
        repository: It stays as it is.
        widest: The last set of tests to run.
        marker: Expression of pytest's ``-m``.
    """
    started, widths = time.monotonic(), list(Width)
    verdict, width, test = Verdict.NOT_CAUGHT, Width.NAMED, ""
    with copied(repository) as copy:
        fault.seed(copy)
        for width in widths[: widths.index(widest) + 1]:
            done = _pytest(copy, *width.tests(fault), "-x", "-m", marker, first=fault.module)
            verdict, test = _verdict(done)
            if verdict is not Verdict.NOT_CAUGHT:
                break
    return Result(
        name=fault.name,
        file=fault.file,
        verdict=verdict,
        width=width,
        test=test,
        seconds=round(time.monotonic() - started, 1),
    )


def failing_anyway(tests: Iterable[str], repository: Path) -> set[str]:
    """Return those of some tests that fail without any fault, in a copy like those with one."""
    names = sorted(set(tests))
    if not names:
        return set()
    with copied(repository) as clean:
        done = _pytest(clean, *names)
    if done.returncode not in (PASSED, SOME_FAILED):
        raise RuntimeError(f"pytest cannot run without a fault: {done.stdout.strip()[-300:]}")
    return {found[1] for found in _FAILED.finditer(done.stdout)} & set(names)


@contextmanager
def copied(repository: Path) -> Iterator[Path]:
    """Yield a copy of the repository; times of files are kept, so compiled files stay valid."""
    with tempfile.TemporaryDirectory(prefix="fault-") as place:
        yield shutil.copytree(repository, Path(place, "copy"), ignore=LEFT_OUT)


def _verdict(done: subprocess.CompletedProcess[str]) -> tuple[Verdict, str]:
    """Return what a run of pytest says of a fault, and the first test that fails."""
    if done.returncode == PASSED:
        return Verdict.NOT_CAUGHT, ""
    failed = _FAILED.search(done.stdout)
    if done.returncode == SOME_FAILED and failed:
        return Verdict.CAUGHT, failed[1]
    return Verdict.BROKEN, done.stdout.strip()[-300:]


def _pytest(copy: Path, *arguments: str, first: str = PACKAGE) -> subprocess.CompletedProcess[str]:
    """Run pytest on a copy, whose package goes before an installed one; import a module first."""
    code = f"import {first}, pytest, sys; sys.exit(pytest.console_main())"
    quiet = ("-q", "-rfE", "-p", "no:cacheprovider", "-W", f"ignore::{_OF_EARLY_IMPORTS}")
    return subprocess.run(
        [sys.executable, "-c", code, *quiet, *arguments],
        cwd=copy,
        env={**os.environ, "PYTHONPATH": str(copy), "COLUMNS": "300"},
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        errors="replace",
        timeout=LIMIT_S,
        check=False,
    )
