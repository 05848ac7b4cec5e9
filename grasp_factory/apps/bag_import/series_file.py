"""A CSV file of samples that ends in the order of their stamps."""

from __future__ import annotations

import os
from array import array
from collections.abc import Sequence
from pathlib import Path
from typing import BinaryIO

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
        self._file = path.open("xb")
        self._text = _MeasuredText(self._file)
        self._writer = CsvWriter(self._text)
        self._writer.row(columns)
        self._stamps = array("q")
        self._starts = array("q", [self._text.size])

    def add(self, stamp_ns: int, cells: Sequence[Cell]) -> None:
        """Append a row."""
        self._writer.row(cells)
        self._stamps.append(stamp_ns)
        self._starts.append(self._text.size)

    def finish(self) -> None:
        """Close the file, sorted."""
        self._file.close()
        stamps = np.array(self._stamps, np.int64)
        if (np.diff(stamps) >= 0).all():
            return
        unsorted = self._path.with_name(f"{self._path.name}.unsorted")
        os.replace(self._path, unsorted)
        with unsorted.open("rb") as rows, self._path.open("xb") as file:
            file.write(rows.read(self._starts[0]))
            for k in np.argsort(stamps, kind="stable").tolist():
                rows.seek(self._starts[k])
                file.write(rows.read(self._starts[k + 1] - self._starts[k]))
        unsorted.unlink()

    def close(self) -> None:
        """Close the file after an error."""
        self._file.close()


class _MeasuredText:
    """Text that is written to a file, and how many bytes it has."""

    def __init__(self, file: BinaryIO) -> None:
        self._file = file
        self.size = 0

    def write(self, text: str) -> int:
        """Append a text."""
        data = text.encode()
        self.size += len(data)
        return self._file.write(data)
