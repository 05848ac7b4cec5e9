"""Formatting of text for people: tables, escaped text, numbers, rates, sizes and times."""

from __future__ import annotations

import unicodedata
from collections.abc import Iterable, Sequence
from textwrap import wrap


def table(rows: Iterable[Sequence[object]], right: Iterable[int] = ()) -> str:
    """Return rows as aligned columns; columns with an index in ``right`` are right-aligned."""
    cells = [[escaped(str(cell)) for cell in row] for row in rows]
    widths = [max(map(len, column)) for column in zip(*cells, strict=True)]
    flush = set(right)
    lines = [
        "  ".join(
            cell.rjust(width) if i in flush else cell.ljust(width)
            for i, (cell, width) in enumerate(zip(row, widths, strict=True))
        ).rstrip()
        for row in cells
    ]
    return "\n".join(lines)


def escaped(text: str) -> str:
    """Return a text whose unprintable characters, which a terminal may obey, are escape codes."""
    if text.isprintable():
        return text
    return "".join(
        c
        if c.isprintable() or unicodedata.category(c) == "Zs"  # a space that does not break a line
        else c.encode("unicode_escape", "surrogatepass").decode("ascii")
        for c in text
    )


def escaped_lines(text: str) -> str:
    """Return a text as ``escaped`` does, but with its line breaks and tabs."""
    return "\n".join("\t".join(map(escaped, line.split("\t"))) for line in text.split("\n"))


def joined_lines(lines: Iterable[str]) -> str:
    """Return texts as lines: each is one line, whatever is in it."""
    return "\n".join(map(escaped, lines))


def named_lines(parts: Iterable[tuple[str, str]], widest: int, most: int) -> list[str]:
    """Return names and texts as lines: a name, and beside it its text in a few lines.

    Args:
        parts: names of up to 10 characters, and texts.
        widest: characters of a line.
        most: lines of a text; what is longer ends with dots.
    """
    lines = []
    for name, text in parts:
        words = wrap(
            escaped(text), widest - 13, break_on_hyphens=False, max_lines=most, placeholder=" ..."
        )
        lines += [f"  {'' if k else escaped(name):<11}{line}" for k, line in enumerate(words)]
    return lines


def bar(share: float, width: int) -> str:
    """Return a bar for a share in [0, 1]; a share of 1 has ``width`` characters.

    The bar is empty only for a share of 0.
    """
    return "#" * max(1, round(share * width)) if share > 0.0 else ""


def count(number: int, noun: str) -> str:
    """Return a number with its noun; the noun is plural unless the number is 1."""
    return f"{number} {noun}" + ("" if number == 1 else "s")


def percent(rate: float | None) -> str:
    """Return a rate from 0 to 1 in per cent, or a dash for None."""
    return "-" if rate is None else f"{100 * rate:.1f} %"


def size_text(size: float) -> str:
    """Return a number of bytes in a readable unit, with powers of 1000."""
    for unit in ("B", "kB", "MB", "GB"):
        if size < 1000:
            return f"{size:.0f} {unit}" if unit == "B" else f"{size:.1f} {unit}"
        size /= 1000
    return f"{size:.1f} TB"


def duration_text(seconds: float) -> str:
    """Return seconds in a readable unit."""
    if seconds < 120:
        return f"{seconds:.0f} s"
    if seconds < 2 * 3600:
        return f"{seconds / 60:.0f} min"
    return f"{seconds / 3600:.1f} h" if seconds < 48 * 3600 else f"{seconds / 86400:.1f} days"
