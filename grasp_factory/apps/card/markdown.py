"""Markdown from data: words, tables and blocks, with all markup in the data escaped."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence

from grasp_factory.core.text_format import escaped

_PLAIN = re.compile(r"[A-Za-z0-9_./-]+(?: [A-Za-z0-9_./-]+)*")
_SPECIAL = frozenset("\\`*_[]<>#|&~$!@^:")
"""Characters that have a meaning in Markdown, HTML or the renderers' extensions."""


def word(text: str) -> str:
    """Return a text as code that is also safe in a cell of a table.

    Backslashes do not escape between backticks, so a text that is not plain becomes HTML.
    """
    if _PLAIN.fullmatch(text):
        return f"`{text}`"
    inner = "".join(c if c.isalnum() and c.isascii() else _entity(c) for c in _visible(text))
    return f"<code>{inner}</code>"


def escape(text: str) -> str:
    """Return a text as normal text of one line in which nothing is markup."""
    return "".join(_entity(c) if c in _SPECIAL else c for c in _visible(text))


def table(head: Sequence[str], rows: Iterable[Sequence[object]], right: Iterable[int] = ()) -> str:
    """Return a table; columns whose position is in ``right`` are right-aligned.

    Args:
        head: Titles.
        rows: Cells in Markdown, which ``word`` and ``escape`` make from data.
        right: Positions of columns, from 0.
    """
    flush = set(right)
    rule = ["---:" if i in flush else "---" for i in range(len(head))]
    lines = [head, rule, *rows]
    return "\n".join("| " + " | ".join(map(str, line)) + " |" for line in lines)


def fenced(text: str, language: str) -> str:
    """Return a text as a block of code; the fence is longer than any in it."""
    longest = max((len(run) for run in re.findall("`+", text)), default=0)
    fence = "`" * max(3, longest + 1)
    end = "" if text.endswith("\n") else "\n"
    return f"{fence}{language}\n{text}{end}{fence}"


def details(summary: str, body: str) -> str:
    """Return a block that is collapsed until the reader opens it."""
    return f"<details>\n<summary>{summary}</summary>\n\n{body}\n\n</details>"


def _visible(text: str) -> str:
    """Return a text as one line; characters that cannot be printed become escapes."""
    return escaped(" ".join(text.split()))


def _entity(character: str) -> str:
    return character if character == " " else f"&#{ord(character)};"
