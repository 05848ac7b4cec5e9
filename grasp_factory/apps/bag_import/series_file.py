"""A CSV file of samples that ends in the order of their stamps."""

from __future__ import annotations

import csv
from array import array
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from grasp_factory.apps.bag_import.series_rows import Cell
from grasp_factory.core.csv_text import CsvWriter


class SeriesFile:
    """Rows are written as they come; if they did not ascend, the file is sorted at the end."""

    def __init__(self, path: Path, columns: Sequence[str]) -> None:
        """Create the file.

        Raises:
            OSError: if it cannot be written, as in all methods.
        """
        self._path = path
        self._file = path.open("x", encoding="utf-8", newline="")
        self._writer = CsvWriter(self._file)
        self._writer.row(columns)
        self._stamps = array("q")

    def add(self, stamp_ns: int, cells: Sequence[Cell]) -> None:
        """Append a row."""
        self._stamps.append(stamp_ns)
        self._writer.row(cells)

    def finish(self) -> None:
        """Close the file, sorted."""
        self._file.close()
        stamps = np.frombuffer(self._stamps, np.int64) if self._stamps else np.empty(0, np.int64)
        if (np.diff(stamps) >= 0).all():
            return
        with self._path.open(encoding="utf-8", newline="") as file:
            head, *rows = csv.reader(file)
        with self._path.open("w", encoding="utf-8", newline="") as file:
            writer = csv.writer(file, lineterminator="\n")
            writer.writerow(head)
            writer.writerows(rows[k] for k in np.argsort(stamps, kind="stable"))

    def close(self) -> None:
        """Close the file after an error."""
        self._file.close()


def seconds(stamp_ns: int) -> str:
    """Return a stamp in seconds with all of its nine decimal places."""
    whole, part = divmod(abs(stamp_ns), 10**9)
    return f"{'-' if stamp_ns < 0 else ''}{whole}.{part:09d}"
