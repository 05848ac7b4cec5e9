"""How long work is followed: whoever wants to know is told of each step."""

from __future__ import annotations

import contextlib
from collections.abc import Callable
from contextlib import AbstractContextManager

ProgressWatch = Callable[[str, int], AbstractContextManager[Callable[[], None]]]
"""From what is done, and in how many steps, to a context that gives what to call after each."""


def unwatched(what: str, steps: int) -> AbstractContextManager[Callable[[], None]]:
    """Tell nobody."""
    del what, steps
    return contextlib.nullcontext(lambda: None)
