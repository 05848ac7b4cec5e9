"""Consent of the people who can be seen in a session, as ``session.yaml`` says it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from grasp_factory.core.serialization import check, from_plain
from grasp_factory.errors import ConfigError, shown

ANSWERS = ("yes", "no", "unknown")
_LONGEST = 200
"""Characters of a text."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Consent:
    """Whether the people in the images agreed, who says so, and to what."""

    given: str = "unknown"
    """One of ``ANSWERS``."""
    by: str = ""
    """Who gave it, or who is responsible for it: a role or a reference, better than a name."""
    scope: str = ""
    """What it covers, such as: research, no publication."""

    def __post_init__(self) -> None:
        check(self.given in ANSWERS, "consent.given", self.given, ", ".join(ANSWERS))
        for key in ("by", "scope"):
            text = getattr(self, key)
            valid = f"a text of up to {_LONGEST} characters"
            check(isinstance(text, str) and len(text) <= _LONGEST, f"consent.{key}", text, valid)


def consent_of(settings: Mapping[str, Any]) -> Consent:
    """Return the consent that the settings of a session state; unknown if they say nothing.

    ``consent: yes`` is the short form of ``consent: {given: yes}``. YAML reads yes and no without
    quotes as true and false, which mean the same here.

    Raises:
        ConfigError: if it is neither.
    """
    found = settings.get("consent")
    if found is None:
        return Consent()
    if isinstance(found, str | bool):
        return Consent(given=_answer(found))
    if not isinstance(found, Mapping):
        valid = f"{', '.join(ANSWERS)}, or a mapping with given, by and scope"
        raise ConfigError(f"consent: got {shown(found)}, valid: {valid}")
    given = _answer(found.get("given", "unknown"))
    return from_plain(Consent, {**found, "given": given}, "consent")


def _answer(value: Any) -> Any:
    return {True: "yes", False: "no"}[value] if isinstance(value, bool) else value
