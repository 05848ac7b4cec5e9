"""CSV that is safe to open: a spreadsheet computes no text in it, and a terminal obeys none.

Spreadsheets compute texts that begin with ``=``, ``+``, ``-`` or ``@``, also of full width, and
those that begin with a tab or a line break, when they open a CSV file (OWASP, "CSV Injection").
Such texts get a ``'`` in front. So do these characters after a semicolon, a tab or a line break,
because a spreadsheet may take those for the end of a cell. Unprintable characters, other than line
breaks and tabs, are written as escape codes. JSON output has the exact texts.
"""

from __future__ import annotations

import csv
import re
from collections.abc import Iterable
from typing import TYPE_CHECKING, Any

from grasp_factory.core.text_format import escaped_lines

if TYPE_CHECKING:
    from _typeshed import SupportsWrite

_SIGNS = "=+@\uff1d\uff0b\uff0d\uff20-"
_COMPUTED = re.compile(rf"\A(?=[\t\n{_SIGNS}])|(?<=[;\t\n])(?=[{_SIGNS}])")


class CsvWriter:
    """Writes rows; lines end with a line feed."""

    def __init__(self, out: SupportsWrite[str], *, quotes_text: bool = False) -> None:
        """Write nothing yet.

        Args:
            out: an open text file, or what takes texts as one does.
            quotes_text: put every text in quotes, not only where it is necessary.
        """
        self._writer = csv.writer(
            out,
            lineterminator="\n",
            quoting=csv.QUOTE_NONNUMERIC if quotes_text else csv.QUOTE_MINIMAL,
        )

    def row(self, cells: Iterable[Any]) -> None:
        """Write a row; None is an empty cell."""
        self._writer.writerow([_safe(cell) if isinstance(cell, str) else cell for cell in cells])


def _safe(text: str) -> str:
    return _COMPUTED.sub("'", escaped_lines(text))
