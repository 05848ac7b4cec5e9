"""The exceptions of grasp-factory, and the table lookup that raises one of them.

GraspFactoryError
├── UsageError                  the user asked for something impossible (exit code 2)
│   ├── ConfigError             also ValueError: a config key or value
│   ├── UnknownNameError        also KeyError: a name that its table does not have
│   └── StoreMismatchError      the store at that path belongs to another run or is no store
├── StoreError                  a store that cannot be read or written (exit code 1)
│   └── StoreBusyError          another process holds the store
├── RecipeError                 a recipe that cannot be built; the episode is quarantined
└── WorkerError                 a worker process died; what is committed stays
"""

from __future__ import annotations

import difflib
from collections.abc import Iterable, Mapping
from typing import TypeVar

T = TypeVar("T")


class GraspFactoryError(Exception):
    """Base of every error that this package raises on purpose."""


class UsageError(GraspFactoryError):
    """The user asked for something that cannot be done; the message says what is valid."""


class ConfigError(UsageError, ValueError):
    """A config key or value that is not valid."""


class UnknownNameError(UsageError, KeyError):
    """A name that is not in its table."""

    def __str__(self) -> str:  # KeyError would print the repr of the message
        return str(self.args[0])


class StoreMismatchError(UsageError):
    """The path holds something else than the store that the command asks for."""


class StoreError(GraspFactoryError):
    """A store that cannot be read or written."""


class StoreBusyError(StoreError):
    """Another process is writing to the store."""


class RecipeError(GraspFactoryError):
    """An episode's recipe cannot be built or simulated; the episode is quarantined."""


class WorkerError(GraspFactoryError):
    """A worker process died before it had finished its block."""


def nearest(name: str, valid: Iterable[str]) -> str:
    """Return a ``; did you mean 'x'?`` hint, or an empty string when nothing is close."""
    close = difflib.get_close_matches(name, list(valid), n=1)
    return f"; did you mean {close[0]!r}?" if close else ""


def lookup(table: Mapping[str, T], kind: str, name: str) -> T:
    """Return ``table[name]``.

    Raises:
        UnknownNameError: naming the kind, the name, the nearest and all valid names.
    """
    if name in table:
        return table[name]
    valid = ", ".join(sorted(table))
    raise UnknownNameError(f"unknown {kind} {name!r}{nearest(name, table)} (valid: {valid})")
