"""Facts that a publisher states about a dataset and that are not in the store."""

from __future__ import annotations

import datetime
import re
from dataclasses import dataclass

from grasp_factory.apps.card.licences import LICENCES
from grasp_factory.errors import UsageError, lookup, shown

LONGEST_NAME = 200
FIRST_VERSION = "1.0.0"


@dataclass(frozen=True, slots=True, kw_only=True)
class Publication:
    """How a dataset is published; None means the store's value, or no value.

    Raises:
        UsageError: for a value that is invalid in a card.
    """

    name: str | None = None
    """Its title; None for the store's name."""
    description: str | None = None
    """Markdown below the title; None for a sentence from the store's config."""
    licence: str | None = None
    """One of the Hub's identifiers; None for the licence that the store states."""
    url: str | None = None
    """Its web page."""
    date_published: str | None = None
    """YYYY-MM-DD."""
    version: str = FIRST_VERSION
    """MAJOR.MINOR.PATCH."""

    def __post_init__(self) -> None:
        if self.name is not None:
            ok = self.name.isprintable() and self.name.strip() != ""
            ok = ok and len(self.name) <= LONGEST_NAME
            _check(ok, "name", self.name, f"one line of up to {LONGEST_NAME} characters")
        if self.description is not None:
            lines = self.description.splitlines()
            ok = all(line.replace("\t", " ").isprintable() for line in lines)
            _check(ok and any(lines), "description", self.description, "text")
        if self.licence is not None:
            lookup(LICENCES, "licence", self.licence)
        if self.url is not None:
            ok = re.fullmatch(r"https?://[!-~]+", self.url) is not None
            ok = ok and not set(self.url) & set('<>"\\^`{|}')
            _check(ok, "url", self.url, "an address that begins with https://")
        if self.date_published is not None:
            ok = _is_day(self.date_published)
            _check(ok, "date-published", self.date_published, "a day, as in 2026-01-31")
        number = "(0|[1-9][0-9]{0,8})"
        ok = re.fullmatch(rf"{number}\.{number}\.{number}", self.version) is not None
        _check(ok, "version", self.version, "MAJOR.MINOR.PATCH, as in 1.0.0")


def _is_day(text: str) -> bool:
    try:
        if not re.fullmatch("[0-9]{4}-[0-9]{2}-[0-9]{2}", text):
            return False
        datetime.date.fromisoformat(text)
    except ValueError:
        return False
    return True


def _check(ok: bool, option: str, got: str, valid: str) -> None:
    if not ok:
        raise UsageError(f"--{option}: got {shown(got)}, valid: {valid}")
