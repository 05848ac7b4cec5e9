"""Columns of numbers from a CSV file with a head. Call it in a process with limits."""

from __future__ import annotations

import csv
import os
from array import array
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from grasp_factory.core.geometry import Array
from grasp_factory.core.regular_file import open_regular
from grasp_factory.errors import CaptureError, UsageError, shown


def read_columns(
    path: Path, needed: Sequence[str], optional: Sequence[str] = ()
) -> dict[str, Array]:
    """Return columns by name, (N,) each; an empty cell is NaN.

    Args:
        path: the file; its first line names the columns.
        needed: columns that must be there.
        optional: columns that are read if they are there.

    Raises:
        UsageError: if the file cannot be opened.
        CaptureError: for a missing column, or a cell that is no number.
    """
    try:
        descriptor = open_regular(path, os.O_RDONLY)
    except OSError as error:
        raise UsageError(f"{path} cannot be read: {error.strerror or error}") from None
    try:
        with open(descriptor, encoding="utf-8-sig", newline="") as file:
            return _parsed(path, csv.reader(file), needed, optional)
    except (UnicodeDecodeError, csv.Error) as error:
        raise CaptureError(f"{path} is no CSV file: {error}") from None


def _parsed(
    path: Path, rows: Iterator[list[str]], needed: Sequence[str], optional: Sequence[str]
) -> dict[str, Array]:
    head = [name.strip() for name in next(rows, [])]
    missing = [name for name in needed if name not in head]
    if missing:
        got = shown(head)
        raise CaptureError(f"{path}: no column {missing[0]}, got {got}, valid: {', '.join(needed)}")
    names = [name for name in (*needed, *optional) if name in head]
    places = [head.index(name) for name in names]
    columns = [array("d") for _ in names]
    for number, row in enumerate(rows, 2):
        if not row:
            continue
        try:
            for column, place in zip(columns, places, strict=True):
                column.append(float(row[place]) if row[place].strip() else float("nan"))
        except (ValueError, IndexError):
            what = f"got {shown(row)}, valid: numbers"
            raise CaptureError(f"{path}: line {number}: {what}") from None
    return {name: doubles(column) for name, column in zip(names, columns, strict=True)}


def doubles(values: array[float]) -> Array:
    """Return an array of doubles without a copy."""
    return np.frombuffer(values, np.float64) if values else np.empty(0)
