"""Progress of long work: a callback reports each step."""

from __future__ import annotations

import contextlib
from collections.abc import Callable
from contextlib import AbstractContextManager

ProgressWatch = Callable[[str, int], AbstractContextManager[Callable[[], None]]]
"""Takes a description of the work and its number of steps.

Returns a context whose value is called after each step.
"""


def unwatched(what: str, steps: int) -> AbstractContextManager[Callable[[], None]]:
    """Report nothing."""
    del what, steps
    return contextlib.nullcontext(lambda: None)
