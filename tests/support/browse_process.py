"""A real `grasp-factory browse` process, and plain connections to it."""

from __future__ import annotations

import contextlib
import os
import signal
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from http.client import HTTPConnection
from pathlib import Path

from grasp_factory.core.cache import VARIABLE

PATIENCE_S = 20.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Running:
    """A running command."""

    url: str
    """What it printed, in a line of its own."""
    process: subprocess.Popen[str]
    errors: Path
    """What it said on stderr."""

    @property
    def plain_url(self) -> str:
        """The page's address without the token, ending in a slash."""
        return self.url.partition("#")[0]

    @property
    def token(self) -> str:
        return self.url.partition("#token=")[2]

    @property
    def host(self) -> str:
        """Address and port."""
        return self.url.split("/")[2]

    @property
    def port(self) -> int:
        return int(self.host.rpartition(":")[2])

    def connect(self) -> HTTPConnection:
        return HTTPConnection(self.host, timeout=PATIENCE_S)

    def get(self, address: str) -> tuple[int, bytes]:
        """Return status and body of what an address answers."""
        with contextlib.closing(self.connect()) as connection:
            connection.request("GET", address)
            answer = connection.getresponse()
            return answer.status, answer.read()

    def stop(self) -> tuple[int, str, str]:
        """Press Ctrl-C; return exit code, the rest of stdout, and stderr."""
        self.process.send_signal(signal.SIGINT)
        assert self.process.stdout is not None
        code = self.process.wait(PATIENCE_S)
        return code, self.process.stdout.read(), self.errors.read_text()


@contextlib.contextmanager
def browsing(
    *options: object, cache: Path | None = None, python: str | Path = sys.executable
) -> Iterator[Running]:
    """Run the command until the block ends, with a cache of its own unless one is given."""
    command = [str(python), "-m", "grasp_factory", "browse", "--no-open", *map(str, options)]
    with tempfile.TemporaryDirectory() as folder:
        errors = Path(folder) / "stderr"
        own = {VARIABLE: str(cache or Path(folder) / "cache"), "GRASP_FACTORY_USER": "tester"}
        with (
            _interruptible(),
            errors.open("w") as stderr,
            subprocess.Popen(
                command,
                stdout=subprocess.PIPE,
                stderr=stderr,
                text=True,
                start_new_session=True,
                env={**os.environ, **own},
            ) as process,
        ):
            try:
                assert process.stdout is not None
                url = process.stdout.readline().strip()
                assert url.startswith("http://"), errors.read_text()
                yield Running(url=url, process=process, errors=errors)
            finally:
                if process.poll() is None:
                    process.send_signal(signal.SIGINT)
                try:
                    process.wait(PATIENCE_S)
                except subprocess.TimeoutExpired:
                    process.kill()
                    raise


@contextlib.contextmanager
def _interruptible() -> Iterator[None]:
    """Let children take Ctrl-C, even where this process, in a shell's background, ignores it."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)
