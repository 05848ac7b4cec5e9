"""The hooks of long functions that show their progress on stderr."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator

from grasp_factory.core.progress import Progress


@contextlib.contextmanager
def counted(each: str, unit: str = "episode") -> Iterator[dict[str, Callable[..., None]]]:
    """Yield the hooks ``on_start`` and ``each`` of a loop; they show its progress."""
    with contextlib.ExitStack() as stack:
        progresses: list[Progress] = []

        def start(total: int) -> None:
            progresses.append(stack.enter_context(Progress(total, unit)))

        def count(*_: int) -> None:
            progresses[-1].count()

        yield {"on_start": start, each: count}


@contextlib.contextmanager
def watched(what: str, steps: int) -> Iterator[Callable[[], None]]:
    """Yield a function to call after each step; it shows the progress."""
    with Progress(steps, what) as progress:
        yield progress.count
