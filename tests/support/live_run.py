"""A real `grasp-factory generate --live` process, and what its page is served, for tests."""

from __future__ import annotations

import contextlib
import json
import os
import re
import signal
import subprocess
import sys
import time
import urllib.request
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import pytest

PATIENCE_S = 150.0
SMALL = ("--resolution", "96x72", "--set", "block_size=2", "--seed", "5")
ALONE = ("--workers", "1")
"""For a run whose workers are not the point: it starts with less work."""


class LiveRun:
    """A run in a process of its own. Its output goes to files, lest a pipe fill up."""

    def __init__(self, process: subprocess.Popen[str], folder: Path) -> None:
        self.process, self._folder = process, folder

    @property
    def out(self) -> str:
        """What it has printed on stdout so far."""
        return (self._folder / "stdout").read_text()

    @property
    def err(self) -> str:
        """What it has printed on stderr so far."""
        return (self._folder / "stderr").read_text()

    @property
    def url(self) -> str:
        """The address that it printed, with the token."""
        return self.until(lambda: re.search(r"http://\S+", self.err)).group()

    def get(self, path: str) -> bytes:
        """Ask its server for something; raises OSError where it does not answer well."""
        base = self.url.partition("/#")[0]
        with contextlib.closing(urllib.request.urlopen(f"{base}{path}", timeout=20)) as answer:
            return bytes(answer.read())

    def state(self) -> dict[str, Any]:
        """Return what /api/live says."""
        found: dict[str, Any] = json.loads(self.get("/api/live"))
        return found

    def until(self, condition: Callable[[], Any]) -> Any:
        """Wait until a condition holds; return its value."""
        deadline = time.monotonic() + PATIENCE_S
        while True:
            with contextlib.suppress(OSError):
                if found := condition():
                    return found
            if time.monotonic() > deadline:
                pytest.fail(f"waited {PATIENCE_S:g} s in vain; the run says: {self.err}")
            time.sleep(0.05)

    def wait(self) -> int:
        """Wait for its end; return the exit code."""
        return self.process.wait(PATIENCE_S)


@contextlib.contextmanager
def running(out: Path, n: int, options: Sequence[str] = SMALL) -> Iterator[LiveRun]:
    """Make a small dataset with a live view until the block ends."""
    folder = out.parent / f"{out.name}.said"
    folder.mkdir(exist_ok=True)
    command = [sys.executable, "-m", "grasp_factory", "generate", "--live", "--n", str(n)]
    with (
        (folder / "stdout").open("w") as stdout,
        (folder / "stderr").open("w") as stderr,
        subprocess.Popen(
            [*command, "--out", str(out), *options],
            stdout=stdout, stderr=stderr, text=True, start_new_session=True,
            env={**os.environ, "GRASP_FACTORY_CACHE": str(out.parent / "cache")},
        ) as process,
    ):  # fmt: skip
        try:
            yield LiveRun(process, folder)
        finally:
            with contextlib.suppress(ProcessLookupError):
                os.killpg(process.pid, signal.SIGKILL)
