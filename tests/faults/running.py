"""One fault in a copy of the repository, and what the tests say of it."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path

from faults.fault import Fault

LEFT_OUT = shutil.ignore_patterns(".*", "*.egg-info")
LIMIT_S = 3600.0
"""Of one run of pytest; each test has a limit of its own (setup.cfg)."""
_FAILED = re.compile(r"^(?:FAILED|ERROR) (\S+::.+?)(?: - .*)?$", re.MULTILINE)
PASSED, SOME_FAILED = 0, 1
"""Exit codes of pytest; all others say that it could not run the tests."""


class Verdict(StrEnum):
    """What came of a fault."""

    CAUGHT = "caught"
    """A test fails with the fault and passes without it."""
    NOT_CAUGHT = "not caught"
    BROKEN = "broken"
    """The changed module does not import, or pytest cannot run: no fair fault."""
    UNSOUND = "unsound"
    """The test that fails with the fault fails without it, too."""


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
        if why := import_error(fault, copy):
            verdict, test = Verdict.BROKEN, why
        else:
            for width in widths[: widths.index(widest) + 1]:
                verdict, test = _verdict(fault, copy, repository, width.tests(fault), marker)
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


@contextmanager
def copied(repository: Path) -> Iterator[Path]:
    """Yield a copy of the repository; times of files are kept, so compiled files stay valid."""
    with tempfile.TemporaryDirectory(prefix="fault-") as place:
        yield shutil.copytree(repository, Path(place, "copy"), ignore=LEFT_OUT)


def import_error(fault: Fault, copy: Path) -> str:
    """Return the last line of the error when the changed module is imported; empty for none."""
    if fault.module is None:
        return ""
    done = _python(copy, "-c", f"import {fault.module}")
    return (done.stdout.strip().splitlines() or ["?"])[-1] if done.returncode else ""


def _verdict(
    fault: Fault, copy: Path, repository: Path, tests: Sequence[str], marker: str
) -> tuple[Verdict, str]:
    done = _pytest(copy, *tests, "-m", marker)
    if done.returncode == PASSED:
        return Verdict.NOT_CAUGHT, ""
    failed = _FAILED.search(done.stdout)
    if done.returncode != SOME_FAILED or failed is None:
        return Verdict.BROKEN, done.stdout.strip()[-300:]
    with copied(repository) as clean:
        passes = _pytest(clean, failed[1]).returncode == PASSED
    return (Verdict.CAUGHT if passes else Verdict.UNSOUND), failed[1]


def _pytest(copy: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    return _python(copy, "-m", "pytest", "-x", "-q", "-rfE", "-p", "no:cacheprovider", *arguments)


def _python(copy: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    """Run Python on a copy, whose package goes before an installed one."""
    return subprocess.run(
        [sys.executable, *arguments],
        cwd=copy,
        env={**os.environ, "PYTHONPATH": str(copy), "COLUMNS": "300"},
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        errors="replace",
        timeout=LIMIT_S,
        check=False,
    )
