"""Checks of text from people: any script is valid, but no invisible characters."""

from __future__ import annotations

import unicodedata
from typing import Any

from grasp_factory.core.serialization import check

_UNSEEN = {"Cc", "Cf", "Co", "Cs", "Zl", "Zp"}
"""Unicode's categories of invisible characters."""
_JOINERS = "\u200c\u200d"
"""Invisible characters that are valid, because some scripts and emoji need them."""


def checked_text(key: str, value: Any, most: int, *, least: int = 1, without: str = "") -> str:
    """Return a text of one line, in Unicode form NFC and without surrounding white space.

    Args:
        key: the name of the text in errors.
        value: the value from a person.
        most: the maximum number of characters.
        least: the minimum number of characters.
        without: characters that the text must not contain.

    Raises:
        ConfigError: if the value is not such a text.
    """
    text = _composed(value, most)
    ok = least <= len(text) <= most and not any(c in without or _is_unseen(c) for c in text)
    but = f" without {without!r}" if without else ""
    check(ok, key, value, f"{least} to {most} printable characters in one line{but}")
    return text


def checked_lines(key: str, value: Any, most: int) -> str:
    """Return a text of any number of lines, in form NFC and without surrounding white space.

    Raises:
        ConfigError: if the value is not such a text.
    """
    text = _composed(value, most).replace("\r\n", "\n").replace("\r", "\n")
    ok = len(text) <= most and not any(_is_unseen(c) and c not in "\n\t" for c in text)
    check(ok, key, value, f"up to {most} printable characters and line breaks")
    return text


def _composed(value: Any, most: int) -> str:
    """Return a text in Unicode form NFC, without surrounding white space.

    For a non-string or oversized value, return a placeholder that the length check rejects.
    """
    if not isinstance(value, str) or len(value) > 4 * most + 4:
        return "x" * (most + 1)
    return unicodedata.normalize("NFC", value).strip()


def _is_unseen(character: str) -> bool:
    return unicodedata.category(character) in _UNSEEN and character not in _JOINERS
