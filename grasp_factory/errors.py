"""The exceptions of grasp-factory, and functions for their messages.

GraspFactoryError
├── UsageError                  the user asked for something impossible (exit code 2)
│   ├── ConfigError             also ValueError: a config key or value
│   ├── UnknownNameError        also KeyError: a name that is not in its table
│   ├── MissingLibraryError     a library that is not installed
│   ├── PluginError             code of the user that is missing, has changed or does not load
│   └── StoreMismatchError      the path holds another store, or no store
├── StoreError                  a store that cannot be read or written (exit code 1)
│   ├── StoreBusyError          another process holds the store
│   └── RefusedFileError        a file that is not read, because it could do harm
│       ├── IrregularFileError  a link, a pipe or a device where a store's own file should be
│       └── LimitError          a part of a store that is larger than a limit
├── RecipeError                 a recipe that cannot be built; the episode is quarantined
├── StorageError                object storage that does not answer, or refuses access
│   └── AccessRefusedError      the credentials are wrong, or have expired
├── CaptureError                a device, a recording or a calibration that cannot be used
├── WorkerError                 a worker process died; committed episodes stay
└── FailuresError               too many episodes are quarantined
"""

from __future__ import annotations

import difflib
import reprlib
import signal
from collections.abc import Iterable, Mapping
from typing import Any, TypeVar

T = TypeVar("T")

LEAST_PART = 3
"""Characters that a text needs to be taken for a part of a valid name."""
MOST_SHOWN = 50
"""Values of a column that a message lists, and the characters of each."""

EXIT_DONE, EXIT_FAILURE, EXIT_USAGE = 0, 1, 2
EXIT_INTERRUPTED, EXIT_TERMINATED = 128 + signal.SIGINT, 128 + signal.SIGTERM


class Terminated(KeyboardInterrupt):
    """SIGTERM asked the process to end; handled like Ctrl-C, but with another exit code."""


class GraspFactoryWarning(UserWarning):
    """Base of every warning of this package."""


class StaleLockWarning(GraspFactoryWarning):
    """A lock was taken over from a process that ended without releasing it."""


class GraspFactoryError(Exception):
    """Base of every error that this package raises on purpose."""


class UsageError(GraspFactoryError):
    """The user asked for something that cannot be done; the message says what is valid."""


class ConfigError(UsageError, ValueError):
    """A config key or value is not valid."""


class UnknownNameError(UsageError, KeyError):
    """A name is not in its table."""

    def __str__(self) -> str:  # KeyError would print the repr of the message
        return str(self.args[0])


class MissingLibraryError(UsageError):
    """A library that is not installed, or was built wrong; the message says what to do."""


class PluginError(UsageError):
    """Code of the user, or of an installed package, is missing, has changed or cannot be used."""


class StoreMismatchError(UsageError):
    """The path holds another store than the command needs, or no store."""


class StoreError(GraspFactoryError):
    """A store cannot be read or written."""


class StoreBusyError(StoreError):
    """Another process is writing to the store."""


class RefusedFileError(StoreError):
    """A file that is not read, because a store from a stranger could do harm by it."""


class IrregularFileError(RefusedFileError):
    """A link, a pipe or a device is where a file of a store should be."""


class LimitError(RefusedFileError):
    """A part of a store is larger than a limit; the message says how to raise it."""


class StorageError(GraspFactoryError):
    """Object storage does not answer, answers nonsense, or refuses access; nothing is damaged."""


class AccessRefusedError(StorageError):
    """Object storage refuses the credentials of the environment, or they have expired."""


class RecipeError(GraspFactoryError):
    """An episode's recipe cannot be built or simulated; the episode is quarantined."""


class CaptureError(GraspFactoryError):
    """A device, a recording or a calibration cannot be used; the message says what to do."""


class WorkerError(GraspFactoryError):
    """A worker process died before it had finished its block."""


class FailuresError(GraspFactoryError):
    """More episodes are quarantined than the run allows; the others are in the store."""


NO_DAMAGE = (RefusedFileError, StorageError)
"""Errors that go through where readers turn any other exception into damage of a store."""


class _Shown(reprlib.Repr):
    """``repr`` that visits a bounded number of items and returns a bounded text."""

    def __init__(self) -> None:
        super().__init__()
        self.maxlevel = 3
        self.maxdict = self.maxlist = self.maxtuple = self.maxset = 8
        self.maxstring = self.maxother = 120
        self.maxlong = 60

    def repr_int(self, x: int, level: int) -> str:
        try:
            return super().repr_int(x, level)
        except ValueError:  # Python does not print integers of more than 4300 digits
            return f"an integer of {x.bit_length()} bits"


def shown(value: Any) -> str:
    """Return a short ``repr(value)`` for an error message, also of a huge or nested value."""
    text = _Shown().repr(value)
    return text if len(text) <= 300 else f"{text[:300]}..."


def did_you_mean(name: str, valid: Iterable[str]) -> str:
    """Return the hint ``; did you mean 'x'?``, or an empty string if no valid name is close.

    For several valid names with commas between them, the hint says how a list is written. Names
    that contain the text are closer than names that only look like it: ``lift`` means
    ``lift_height``, not ``split``.
    """
    name, known = name[:100], sorted(valid)
    parts = {part.strip() for part in name.split(",")}
    if len(parts) > 1 and parts.issubset(known):
        return f"; for any of several: [{name}]"
    close = difflib.get_close_matches(name, known, n=1)
    if len(name) >= LEAST_PART:
        close = [word for word in known if name.casefold() in word.casefold()][:3] or close
    words = " or ".join(map(repr, close))
    return f"; did you mean {words}?" if close else ""


def lookup(table: Mapping[str, T], kind: str, name: str) -> T:
    """Return ``table[name]``.

    Raises:
        UnknownNameError: naming the kind, the name, the nearest and all valid names.
    """
    if name in table:
        return table[name]
    valid = ", ".join(sorted(table)) or "none"
    raise UnknownNameError(
        f"unknown {kind} {shown(name)}{did_you_mean(name, table)} (valid: {valid})"
    )


def unknown_value(column: str, value: str, known: Iterable[str]) -> UnknownNameError:
    """Return the error for a value that no row of a column has.

    Args:
        column: the name of the column.
        value: the value.
        known: the values that rows have. They may come from a stranger's store: the message names
            a bounded number of them, each cut to a bounded length.
    """
    values = sorted({one[:MOST_SHOWN] for one in known})
    hint = did_you_mean(value, values)
    valid = ", ".join(values[:MOST_SHOWN]) or "none"
    if len(values) > MOST_SHOWN:
        valid += f" and {len(values) - MOST_SHOWN} more"
    return UnknownNameError(f"no row has {column} {shown(value)}{hint} (valid: {valid})")
