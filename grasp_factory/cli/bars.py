"""Progress bars on stderr."""

from __future__ import annotations

import contextlib
import sys
from collections.abc import Callable, Iterator

from tqdm import tqdm  # type: ignore[import-untyped]

tqdm.monitor_interval = 0  # without its thread, signals and worker processes stay simple


class Counter:
    """A progress bar, shown where stderr is a terminal."""

    def __init__(self, total: int, unit: str) -> None:
        self._bar = tqdm(
            total=total, unit=unit, disable=not sys.stderr.isatty(), leave=False, dynamic_ncols=True
        )

    def count(self) -> None:
        """Advance by one."""
        self._bar.update()

    def __enter__(self) -> Counter:
        return self

    def __exit__(self, *_: object) -> None:
        """Close the bar."""
        self._bar.close()


@contextlib.contextmanager
def counted(each: str, unit: str = "episode") -> Iterator[dict[str, Callable[..., None]]]:
    """Yield the hooks ``on_start`` and ``each`` of a loop; they show a bar."""
    with contextlib.ExitStack() as stack:
        counters: list[Counter] = []

        def start(total: int) -> None:
            counters.append(stack.enter_context(Counter(total, unit)))

        def count(*_: int) -> None:
            counters[-1].count()

        yield {"on_start": start, each: count}


@contextlib.contextmanager
def watched(what: str, steps: int) -> Iterator[Callable[[], None]]:
    """Yield a function to call after each step; it advances a bar."""
    with Counter(steps, what) as counter:
        yield counter.count
