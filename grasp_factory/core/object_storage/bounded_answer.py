"""Waiting for an answer of a server, which is given up when it takes too long or too much memory.

The client keeps all of a listing's page in memory. A server could send one without end.
"""

from __future__ import annotations

import resource
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import TypeVar

from grasp_factory.errors import StorageError

T = TypeVar("T")
ANSWER_S = 60.0
"""Seconds for an answer; a server could answer with empty pages without end."""
ANSWER_BYTES = 256 * 2**20
"""Most memory that the process may need more of meanwhile; a page has 1000 names, about 1 MB."""
_LOOK_S = 0.1


def bounded_answer(ask: Callable[[], T], where: object) -> T:
    """Return what a request returns, or raise what it raises.

    Args:
        ask: does the request, in another thread. It cannot be ended: if it is given up, it goes on
            until the client's own limit of time, or the end of this process.
        where: what is asked for, in messages.

    Raises:
        StorageError: if it takes too long or too much memory.
    """
    out: list[T] = []
    errors: list[BaseException] = []

    def run() -> None:
        try:
            out.append(ask())
        except BaseException as error:
            errors.append(error)

    until, before = time.monotonic() + ANSWER_S, _resident_bytes()
    thread = threading.Thread(target=run, daemon=True)
    thread.start()
    thread.join(min(_LOOK_S, ANSWER_S))
    while thread.is_alive():
        if _resident_bytes() - before > ANSWER_BYTES:
            most = ANSWER_BYTES // 2**20
            raise StorageError(f"{where}: a page of the listing has more than {most} MiB")
        if time.monotonic() > until:
            raise StorageError(
                f"{where}: no page of the listing within {ANSWER_S:.0f} s; try again"
            )
        thread.join(_LOOK_S)
    if errors:
        raise errors[0]
    return out[0]


def _resident_bytes() -> int:
    """Return the bytes of memory that this process uses; 0 where the system does not tell."""
    try:
        pages = Path("/proc/self/statm").read_text(encoding="ascii").split()[1]
    except OSError:
        return 0
    return int(pages) * resource.getpagesize()
