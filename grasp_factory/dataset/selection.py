"""Episodes that a user selects by index, or by a file that `query --ids` printed."""

from __future__ import annotations

import os
import warnings
from collections.abc import Iterable, Sequence
from functools import cache
from pathlib import Path
from typing import TextIO

from grasp_factory.core.object_storage.address import is_remote
from grasp_factory.dataset.dataset import Dataset
from grasp_factory.errors import GraspFactoryWarning, UsageError, shown

LONGEST = 9
"""Maximum number of digits of a row."""
LONGEST_LINE = 10_000
"""Maximum number of characters that are read as a line: /dev/zero contains no line break."""


def read_lines(file: TextIO) -> list[tuple[str, int]]:
    """Return the store's path, or an empty text, and the row of each line of a list.

    A line is ROW or STORE:ROW, where STORE is a path. Empty lines are skipped.

    Args:
        file: The file, which errors name.

    Raises:
        UsageError: naming the first invalid line.
    """
    found = []
    try:
        lines = iter(lambda: file.readline(LONGEST_LINE), "")
        for number, line in enumerate(lines, start=1):
            word = line.strip()
            if not word:
                continue
            path, colon, row = word.rpartition(":")
            if not _is_row(row) or (colon and not path):
                what = f"--ids {file.name}: line {number}: got {shown(word)}"
                raise UsageError(f"{what}, valid: one episode index a line, such as 17")
            found.append((path, int(row)))
    except UnicodeDecodeError:
        raise UsageError(f"--ids {file.name}: it is no text, valid: an index a line") from None
    return found


def read_selection(file: TextIO, store: Path) -> list[int]:
    """Return the rows of a store that a file lists, in its order; see ``read_lines``.

    Lines of other stores are left out, and a warning reports how many.

    Args:
        file: The file, which errors name.
        store: The store whose rows are returned.

    Raises:
        UsageError: naming the first invalid line, or if all lines are of other stores.
    """
    lines = read_lines(file)
    rows = rows_of(lines, store)
    others = len(lines) - len(rows)
    if others:
        what = f"--ids {file.name}: {others} of {len(lines)} lines are of other stores"
        if not rows:
            raise UsageError(f"{what}, none of {store}: the first is {shown(lines[0][0])}")
        warnings.warn(f"{what} than {store} and left out", GraspFactoryWarning, stacklevel=2)
    return rows


def read_selections(file: TextIO, stores: Sequence[Path]) -> list[list[int]]:
    """Return the rows of each store that a file lists, in its order; see ``read_lines``.

    For several stores each line must name its store; lines of others are left out.

    Args:
        file: The file, which errors name.
        stores: One or several.

    Raises:
        UsageError: naming the first invalid line, or one of no store.
    """
    if len(stores) == 1:
        return [read_selection(file, stores[0])]
    lines = read_lines(file)
    if not all(path for path, _ in lines):
        raise UsageError("--ids: valid for several stores: lines STORE:ROW, got one without STORE")
    return [rows_of(lines, store) for store in stores]


def rows_of(lines: Iterable[tuple[str, int]], store: Path) -> list[int]:
    """Return the rows of those lines that name this store or no store."""
    is_mine = cache(lambda path: not path or _is_same(path, store))
    return [row for path, row in lines if is_mine(path)]


def with_episode(rows: Sequence[int], there: Sequence[bool], store: Path) -> list[int]:
    """Return the rows of a list that have an episode; `query --ids` also lists other rows.

    A warning reports how many are left out because they are quarantined or not made yet.

    Args:
        rows: As ``read_selection`` returns them. Rows beyond the end of the store are kept.
        there: For each row of the store, whether it has an episode.
        store: The store, which the warning names.

    Raises:
        UsageError: if there are rows, but none of them has an episode.
    """
    found = [row for row in rows if row >= len(there) or there[row]]
    lost = len(rows) - len(found)
    if lost:
        what = f"--ids: {lost} of {len(rows)} rows of {store} have no episode"
        if not found:
            raise UsageError(f"{what}: nothing is left")
        warnings.warn(f"{what} and are left out", GraspFactoryWarning, stacklevel=2)
    return found


def selection_lines(chosen: Iterable[tuple[Path, int]], *, named: bool) -> list[str]:
    """Return the lines of a list of episodes.

    Args:
        chosen: The store and the row of each episode.
        named: Whether each line names the store, as is necessary for several stores.

    Raises:
        UsageError: if a store's path contains a line break, or white space at one of its ends.
    """
    chosen = list(chosen)
    for name in {str(store) for store, _ in chosen} if named else ():
        if name.strip() != name or len(name.splitlines()) > 1:
            raise UsageError(f"store {shown(name)}: a list names stores by line; rename it")
    return [f"{store}:{row}" if named else str(row) for store, row in chosen]


def _is_row(text: str) -> bool:
    return text.isascii() and text.isdecimal() and len(text) <= LONGEST


def _is_same(path: str, store: Path) -> bool:
    if is_remote(store):
        return path.rstrip("/") == str(store)
    if os.path.abspath(path) == os.path.abspath(store):
        return True
    try:
        return os.path.samefile(path, store)
    except (OSError, ValueError):  # one of them does not exist, or is not a valid path
        return False


def check_index(dataset: Dataset, index: int) -> int:
    """Return the index if the store's row is committed or quarantined.

    Raises:
        UsageError: naming the valid indices.
    """
    if not 0 <= index < len(dataset):
        raise UsageError(f"episode {index}: {dataset.path} has episodes 0 to {len(dataset) - 1}")
    if dataset.status[index] == 0:
        raise UsageError(
            f"episode {index} of {dataset.path} is not made yet: run its generate command again"
        )
    return index
