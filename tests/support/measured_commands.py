"""A command in a process of its own that has the package imported: what it says and what it takes.

Importing takes a second, and PyTorch nine. A server imports once, and each command is a fork of it.
"""

from __future__ import annotations

import multiprocessing
import os
import sys
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from multiprocessing.connection import Connection
from pathlib import Path
from unittest.mock import patch

_CONTEXT = multiprocessing.get_context("forkserver")
_CONTEXT.set_forkserver_preload(["support.measured_imports"])
_PATH = os.pathsep.join(sys.path)
"""The server does not get ``sys.path`` of this process."""


@dataclass(frozen=True, slots=True, kw_only=True)
class MeasuredCommand:
    """What a command said and took."""

    code: int
    """Exit code; below 0 the signal that ended it."""
    out: str
    err: str
    seconds: float
    """From its start to its end, s."""
    peak_kb: int
    """Largest resident set of the process or a child, with all that was imported."""


def run_apart(arguments: Sequence[str], folder: Path) -> MeasuredCommand:
    """Run the command with some arguments, in the working directory; its output goes to files."""
    near, far = _CONTEXT.Pipe(duplex=False)
    where = [*arguments], folder, Path.cwd(), dict(os.environ)
    process = _CONTEXT.Process(target=_measure, args=(far, *where))
    with patch.dict(os.environ, PYTHONPATH=_PATH):
        process.start()
    far.close()
    status, seconds, peak_kb = near.recv()
    process.join()
    out, err = ((folder / name).read_text() for name in ("stdout", "stderr"))
    code = os.waitstatus_to_exitcode(status)
    return MeasuredCommand(code=code, out=out, err=err, seconds=seconds, peak_kb=peak_kb)


def _measure(
    answer: Connection,
    arguments: list[str],
    folder: Path,
    there: Path,
    environment: Mapping[str, str],
) -> None:
    started = time.monotonic()
    process = os.fork()
    if not process:
        _become_the_command(arguments, folder, there, environment)
    _, status, used = os.wait4(process, 0)
    answer.send((status, time.monotonic() - started, used.ru_maxrss))


def _become_the_command(
    arguments: list[str], folder: Path, there: Path, environment: Mapping[str, str]
) -> None:
    from grasp_factory.__main__ import main

    os.environ.clear()  # it is that of the server
    os.environ.update(environment)
    os.chdir(there)
    Path("/proc/self/clear_refs").write_text("5")  # its peak begins with that of the server
    for number, name in ((0, os.devnull), (1, folder / "stdout"), (2, folder / "stderr")):
        flags = os.O_RDONLY if number == 0 else os.O_WRONLY | os.O_CREAT | os.O_TRUNC
        os.dup2(os.open(name, flags), number)
    sys.argv = ["grasp-factory", *arguments]
    sys.stdin = open(0, closefd=False)
    main()
