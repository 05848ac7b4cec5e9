"""CSV: no spreadsheet computes a text, no terminal obeys one, and the rest stays as it was."""

from __future__ import annotations

import csv
import io
import re
from unicodedata import category

import pytest
from hypothesis import given
from hypothesis import strategies as st

from grasp_factory.core.csv_text import CsvWriter


def cells(*row: object, quotes_text: bool = False) -> list[str]:
    out = io.StringIO()
    CsvWriter(out, quotes_text=quotes_text).row(row)
    (read,) = csv.reader(io.StringIO(out.getvalue(), newline=""))
    return read


@pytest.mark.parametrize("text", ["=1+1", "+1", "-1+2", "@SUM(A1)", "\tx", "\nx"])
def test_a_text_that_a_spreadsheet_would_compute_begins_with_a_quote(text: str) -> None:
    assert cells(text) == [f"'{text}"]
    assert cells(text, quotes_text=True) == [f"'{text}"]


@pytest.mark.parametrize(
    ("text", "safe"),
    [
        ("a;=1", "a;'=1"),
        ("a\n@b\t-c", "a\n'@b\t'-c"),
        ("\uff1d1", "'\uff1d1"),
        ("a, -1; b", "a, -1; b"),
    ],
)
def test_other_ends_of_a_cell_are_expected(text: str, safe: str) -> None:
    assert cells(text) == [safe]


def test_numbers_and_empty_cells_stay_as_they_are() -> None:
    assert cells(-1.5, 3, None, True) == ["-1.5", "3", "", "True"]


def test_a_terminal_gets_escape_codes() -> None:
    assert cells("a\x1b[31mb\r") == ["a\\x1b[31mb\\r"]


@given(st.text(max_size=30), st.booleans())
def test_whatever_a_text_is_the_cell_is_harmless(text: str, quotes_text: bool) -> None:
    (cell,) = cells(text, quotes_text=quotes_text)
    for part in re.split("[;\t\n]", cell):
        assert not part.startswith(("=", "+", "-", "@", "\uff1d", "\uff0b", "\uff0d", "\uff20"))
    assert not cell.startswith(("\t", "\r", "\n"))
    assert all(c.isprintable() or c in "\t\n" or category(c) == "Zs" for c in cell)
    if text.isprintable() and not set(text) & set("=+-@\uff1d\uff0b\uff0d\uff20"):
        assert cell == text
