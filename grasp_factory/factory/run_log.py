"""The run log next to a store: one line per run, with facts that must not be in the store."""

from __future__ import annotations

import errno
import json
import os
import shlex
import socket
import sys
import time
import warnings
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path
from typing import Any

from grasp_factory import __version__
from grasp_factory.core.limits import LOG
from grasp_factory.core.own_copy import make_own
from grasp_factory.core.place import place_at
from grasp_factory.core.regular_file import open_regular
from grasp_factory.errors import GraspFactoryWarning, IrregularFileError, StoreMismatchError
from grasp_factory.factory.run_request import Request
from grasp_factory.writers.zarr.files import cannot_write


class RunLog:
    """Appends a line to ``<store>.runs.jsonl`` when its ``with`` block ends, also after an error.

    If no work began in the block, no line is written and no file is created.
    """

    def __init__(self, store: Path, request: Request) -> None:
        self.path = store.with_name(f"{store.name}.runs.jsonl")
        self._request = request
        self._made = 0
        self._began = False

    def begin(self) -> None:
        """Note that there is work to do, so that a line is written."""
        self._began = True

    def count(self) -> None:
        """Count an episode as made."""
        self._made += 1

    def __enter__(self) -> RunLog:
        """Open the log and start the clock.

        Raises:
            StoreMismatchError: if it cannot be created, or a link has its name.
            StoreError: if the disk or its permissions prevent writing.
        """
        self._is_new = not os.path.lexists(self.path)
        try:
            make_own(place_at(self.path), LOG)
            descriptor = open_regular(self.path, os.O_RDWR | os.O_APPEND | os.O_CREAT)
            self._file = open(descriptor, "ab+", buffering=0)
        except IrregularFileError as error:
            raise StoreMismatchError(str(error)) from None
        except OSError as error:
            raise cannot_write(self.path, error) from None
        self._started, self._clock = datetime.now(UTC), time.monotonic()
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        """Write the line.

        If the log cannot be written, it warns: no episode is lost.
        """
        try:
            with self._file:
                if self._began:
                    self._append(json.dumps(self._line(kind)))
            if not self._began and self._is_new and not self.path.stat().st_size:
                self.path.unlink()
        except OSError as trouble:
            text = f"{self.path} has no line of this run: {trouble.strerror}"
            warnings.warn(text, GraspFactoryWarning, stacklevel=2)

    def _append(self, line: str) -> None:
        # A full disk or a kill may have cut the last line short: start a new one.
        size = self._file.seek(0, os.SEEK_END)
        is_cut = size > 0 and os.pread(self._file.fileno(), 1, size - 1) != b"\n"
        data = b"\n" * is_cut + f"{line}\n".encode()
        if self._file.write(data) < len(data):  # the disk is full
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    def _line(self, kind: type[BaseException] | None) -> dict[str, Any]:
        seconds = time.monotonic() - self._clock
        return {
            "started": self._started.isoformat(timespec="seconds"),
            "finished": datetime.now(UTC).isoformat(timespec="seconds"),
            "ended": "done" if kind is None else kind.__name__,
            "host": socket.gethostname(),
            "command": shlex.join(sys.argv),
            "asked": self._request.n,
            "workers": self._request.workers,
            "shard": str(self._request.shard),
            "made": self._made,
            "seconds": round(seconds, 3),
            "episodes_per_second": round(self._made / seconds, 3) if seconds else None,
            "versions": {
                "python": sys.version.split()[0],
                "grasp_factory": __version__,
                **{name: version(name) for name in ("pybullet", "numpy", "zarr")},
            },
        }
