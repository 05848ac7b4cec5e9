"""Text from people: any script, but nothing that a reader would not see."""

from __future__ import annotations

import unicodedata
from typing import Any

from grasp_factory.core.serialization import check

_UNSEEN = {"Cc", "Cf", "Co", "Cs", "Zl", "Zp"}
"""Unicode's categories of characters without a look of their own."""
_JOINERS = "\u200c\u200d"
"""Characters of these that scripts and emoji need."""


def checked_text(key: str, value: Any, most: int, *, least: int = 1, without: str = "") -> str:
    """Return a text of one line, composed (NFC) and without white space around it.

    Args:
        key: its name in errors.
        value: what a person gave.
        most: characters.
        least: characters.
        without: a character that it must not have.

    Raises:
        ConfigError: if it is none.
    """
    text = _composed(value, most)
    ok = least <= len(text) <= most and not any(c in without or _is_unseen(c) for c in text)
    but = f" without {without!r}" if without else ""
    check(ok, key, value, f"{least} to {most} printable characters in one line{but}")
    return text


def checked_lines(key: str, value: Any, most: int) -> str:
    """Return a text of any number of lines, composed and without white space around it.

    Raises:
        ConfigError: if it is none.
    """
    text = _composed(value, most).replace("\r\n", "\n").replace("\r", "\n")
    ok = len(text) <= most and not any(_is_unseen(c) and c not in "\n\t" for c in text)
    check(ok, key, value, f"up to {most} printable characters and line breaks")
    return text


def _composed(value: Any, most: int) -> str:
    """Return a text as it is kept, or, in place of what is none or far too long, one too long."""
    if not isinstance(value, str) or len(value) > 4 * most + 4:
        return "x" * (most + 1)
    return unicodedata.normalize("NFC", value).strip()


def _is_unseen(character: str) -> bool:
    return unicodedata.category(character) in _UNSEEN and character not in _JOINERS
