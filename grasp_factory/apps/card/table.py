"""The episodes as one table: a column for each column of the store that has one value per row."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from grasp_factory.core.csv_text import CsvWriter
from grasp_factory.core.schema import Field

NOT_IN_TABLE = frozenset(
    f"episodes/{name}" for name in ("status", "checksum", "fingerprint", "spec", "error")
)
"""Columns that say nothing about a committed episode, or that are too long for a table."""
_CHUNK = 4096
"""Number of rows that are converted to Python objects at a time."""


class Kind(Enum):
    """The type of a column's values; the enum's values are Croissant's names."""

    BOOLEAN = "sc:Boolean"
    INTEGER = "sc:Integer"
    FLOAT = "sc:Float"
    TEXT = "sc:Text"


@dataclass(frozen=True, slots=True, kw_only=True)
class TableColumn:
    """A column of the table."""

    name: str
    kind: Kind
    description: str
    values: NDArray[Any]
    """(n,), of the n committed rows; codes if ``words`` is not empty."""
    words: tuple[str, ...] = ()
    """For codes: the word of each code, by position."""

    def cells(self, start: int, stop: int) -> list[bool | int | float | str]:
        """Return the values of some rows; an empty text for a code without a word."""
        values = self.values[start:stop].tolist()
        if self.words:
            known = len(self.words)
            return [self.words[value] if value < known else "" for value in values]
        return list(values)


def column_of(field: Field, values: NDArray[Any]) -> TableColumn:
    """Return the column of a field of the store."""
    parts = [field.description, f"[{field.units}]" if field.units else ""]
    if field.names:
        parts.append(f"({', '.join(field.names)})")
    return TableColumn(
        name=field.path.removeprefix("episodes/"),
        kind=Kind.TEXT if field.names else kind_of(field),
        description=" ".join(filter(None, parts)),
        values=values,
        words=field.names,
    )


def kind_of(field: Field) -> Kind:
    """Return the kind of a field's values."""
    if field.dtype == "string":
        return Kind.TEXT
    kinds = {"b": Kind.BOOLEAN, "f": Kind.FLOAT}
    return kinds.get(np.dtype(field.dtype).kind, Kind.INTEGER)


def write_table(file: Path, columns: Sequence[TableColumn]) -> None:
    """Write the table as CSV in UTF-8, with the column names in the first line.

    Floats are the shortest texts that parse to the same bits. All texts are in quotes, because a
    name may contain a line break.
    """
    with file.open("w", encoding="utf-8", newline="") as out:
        writer = CsvWriter(out, quotes_text=True)
        writer.row(column.name for column in columns)
        for start in range(0, len(columns[0].values), _CHUNK):
            cells = (column.cells(start, start + _CHUNK) for column in columns)
            for row in zip(*cells, strict=True):
                writer.row(row)
