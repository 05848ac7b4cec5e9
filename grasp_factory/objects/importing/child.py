"""The importer's side of the child process: one for many objects, replaced when it crashes."""

from __future__ import annotations

import os
import select
import signal
import subprocess
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import grasp_factory
from grasp_factory.core.cache import digest
from grasp_factory.core.optional import missing_libraries
from grasp_factory.core.serialization import from_plain, to_plain
from grasp_factory.objects.importing.base import UnusableError
from grasp_factory.objects.importing.messages import Converted, Job, decode, encode, message_length

TIME_LIMIT_S = 1200.0
"""Wall-clock seconds for one object, in case the child sleeps; the child limits its CPU time."""
MAX_REPLY = 64 * 2**20
"""Bytes; the files of an object take about 2 MB."""
MAX_THREADS = 4
"""Threads of the decomposition; its result does not depend on their number."""


class CrashError(UnusableError):
    """The conversion crashed or did not end; it may succeed at another time."""


class Child:
    """Converts objects in another process, which starts with the first object."""

    def __init__(self, time_limit_s: float = TIME_LIMIT_S) -> None:
        self._time_limit_s = time_limit_s
        self._process: subprocess.Popen[bytes] | None = None

    def __enter__(self) -> Child:
        return self

    def __exit__(self, *_: object) -> None:
        self.stop()

    def stop(self) -> None:
        """End the process."""
        if self._process is not None:
            self._process.kill()
            self._process.wait()
            for stream in (self._process.stdin, self._process.stdout):
                if stream:
                    stream.close()
            self._process = None

    def convert(self, job: Job, blobs: Sequence[bytes]) -> tuple[Converted, dict[str, bytes]]:
        """Return the converted object, and its OBJ files by their SHA-256.

        Raises:
            CrashError: if the conversion crashed, or took too long or too much memory.
            UnusableError: if the mesh cannot become an object.
            UsageError: if the libraries are not installed.
        """
        try:
            reply, files = decode(self._exchange(encode({"job": to_plain(job)}, blobs)))
        except BaseException:
            self.stop()
            raise
        if "missing" in reply:
            raise missing_libraries(reply["missing"], extra="meshes")
        if "failed" in reply:
            self.stop()
            raise CrashError(reply["failed"])
        if "refused" in reply:
            raise UnusableError(reply["refused"])
        return from_plain(Converted, reply["converted"]), {digest(file): file for file in files}

    def _exchange(self, message: bytes) -> bytes:
        """Send a message and return the one that comes back."""
        if self._process is None:
            self._process = _start()
        process = self._process
        assert process.stdin and process.stdout
        todo, reply, length = memoryview(message), bytearray(), None
        deadline = time.monotonic() + self._time_limit_s
        while length is None or len(reply) < length:
            rest = deadline - time.monotonic()
            writers = [process.stdin] if todo else []
            readable, writable, _ = select.select([process.stdout], writers, [], max(0.0, rest))
            if not readable and not writable:
                raise CrashError(f"its conversion took more than {self._time_limit_s:g} s")
            try:
                if writable:
                    todo = todo[os.write(process.stdin.fileno(), todo[: 2**20]) :]
            except BrokenPipeError:  # what it wrote before its end is still read
                todo = memoryview(b"")
            if readable:
                part = os.read(process.stdout.fileno(), 2**20)
                if not part:
                    raise CrashError(_cause(process))
                reply += part
                length = message_length(bytes(reply[:8]))
                if length and length > MAX_REPLY:
                    raise CrashError("its conversion returned too much data")
        return bytes(reply)


def _start() -> subprocess.Popen[bytes]:
    threads = str(min(MAX_THREADS, len(os.sched_getaffinity(0))))
    here = str(Path(grasp_factory.__file__).parent.parent)
    environment: dict[str, Any] = {
        **os.environ,
        "OMP_NUM_THREADS": threads,
        "OMP_WAIT_POLICY": "passive",  # waiting takes no CPU time
        "OPENBLAS_NUM_THREADS": "1",
        "PYTHONPATH": os.pathsep.join([here, *filter(None, sys.path)]),
    }
    process = subprocess.Popen(
        [
            sys.executable,
            "-P",
            "-m",
            "grasp_factory.objects.importing.worker",
        ],  # -P: not from this directory
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        bufsize=0,
        env=environment,
        start_new_session=True,  # Ctrl-C goes to the importer, which ends the child
    )
    assert process.stdin
    os.set_blocking(process.stdin.fileno(), False)
    return process


def _cause(process: subprocess.Popen[bytes]) -> str:
    code = process.wait()
    if code == -signal.SIGXCPU:
        return "its conversion took too much computing time: simplify it"
    how = signal.Signals(-code).name if code < 0 else f"exit code {code}"
    return f"its conversion crashed ({how})"
