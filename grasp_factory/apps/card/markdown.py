"""Markdown from data: words, tables and blocks that stay what they are, whatever is in them."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence

from grasp_factory.core.text_format import escaped

_PLAIN = re.compile(r"[A-Za-z0-9_./-]+(?: [A-Za-z0-9_./-]+)*")
_SPECIAL = frozenset("\\`*_[]<>#|&~$!@^:")
"""What Markdown, HTML or the renderers' extras give a meaning."""


def word(text: str) -> str:
    """Return a text as code, also where a table is cut at its bars.

    Backslashes do not do between backticks, so whatever is not plain becomes HTML.
    """
    if _PLAIN.fullmatch(text):
        return f"`{text}`"
    inner = "".join(c if c.isalnum() and c.isascii() else _entity(c) for c in _visible(text))
    return f"<code>{inner}</code>"


def escape(text: str) -> str:
    """Return a text as running text of one line in which nothing is markup."""
    return "".join(_entity(c) if c in _SPECIAL else c for c in _visible(text))


def table(head: Sequence[str], rows: Iterable[Sequence[object]], right: Iterable[int] = ()) -> str:
    """Return a table; columns whose position is in ``right`` are right-aligned.

    Args:
        head: Titles.
        rows: Cells, Markdown already: ``word`` and ``escape`` make it of data.
        right: Positions.
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
    """Return a block that is folded up until somebody opens it."""
    return f"<details>\n<summary>{summary}</summary>\n\n{body}\n\n</details>"


def _visible(text: str) -> str:
    """Return a text of one line: what cannot be printed is spelled out."""
    return escaped(" ".join(text.split()))


def _entity(character: str) -> str:
    return character if character == " " else f"&#{ord(character)};"
