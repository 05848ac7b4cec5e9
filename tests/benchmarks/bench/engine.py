"""A stand-in for the ``pybullet`` module that the factory's modules know, to watch its calls."""

from __future__ import annotations

import contextlib
import sys
from collections.abc import Callable, Iterator
from typing import Any

from grasp_factory.simulation.world.engine import p as pybullet

Call = Callable[..., Any]
Watch = Callable[[str, Call], Call]
"""Given a function's name and the function, returns what to call in its place."""


class _Engine:
    def __init__(self, watch: Watch) -> None:
        self._watch = watch

    def __getattr__(self, name: str) -> Any:
        value = getattr(pybullet, name)
        if not callable(value) or isinstance(value, type):
            return value
        watched = self._watch(name, value)
        setattr(self, name, watched)
        return watched


@contextlib.contextmanager
def watched_engine(watch: Watch) -> Iterator[None]:
    """Let every call of the factory into the engine go through ``watch`` for a while."""
    engine = _Engine(watch)
    modules = [
        module
        for name, module in list(sys.modules.items())
        if name.startswith("grasp_factory.") and getattr(module, "p", None) is pybullet
    ]
    assert modules, "no module of the factory knows the engine as p any more"
    for module in modules:
        setattr(module, "p", engine)  # noqa: B010  it is no attribute that a type checker knows
    try:
        yield
    finally:
        for module in modules:
            setattr(module, "p", pybullet)  # noqa: B010
