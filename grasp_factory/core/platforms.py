"""Fingerprints of platforms: what they consist of, their text, and what a difference means."""

from __future__ import annotations

import dataclasses
import re
import zlib
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

from grasp_factory.errors import StoreError, shown

PARTS: Mapping[str, str] = {
    "engine": "simulation steps",
    "images": "rendered images",
    "libm": "the C library's sine and its kind",
    "arithmetic": "arithmetic of numpy and of this package",
    "network": "answers of torch's networks",
}
"""What each part of a fingerprint is made from."""
FINGERPRINT = "fingerprint"
"""The root attribute that holds the parts, of stores since version 0.5.0."""
ACCEPT = "--accept-other-platform"
NO_FINGERPRINT = "made by a version without fingerprints"
_CHECK = "check"
_DIGEST = re.compile(r"[0-9a-f]{8}")
_LONGEST = 200


@dataclass(frozen=True, slots=True, kw_only=True)
class Fingerprint:
    """Digests of what a platform computes: where they are equal, episodes have equal bytes.

    Each part has 8 hexadecimal digits.
    """

    engine: str
    images: str
    libm: str
    arithmetic: str
    network: str = ""
    """Empty where no trained model has a part in the episodes."""

    def __post_init__(self) -> None:
        """Check the parts.

        Raises:
            StoreError: naming one that is no digest.
        """
        for name, value in self.parts().items():
            if not isinstance(value, str) or not _DIGEST.fullmatch(value):
                valid = "8 hexadecimal digits"
                raise StoreError(f"fingerprint: {name}: got {shown(value)}, valid: {valid}")

    def parts(self) -> dict[str, str]:
        """Return the parts by name; an optional one that is empty is left out."""
        found = {field.name: getattr(self, field.name) for field in dataclasses.fields(self)}
        return {name: value for name, value in found.items() if value or name != "network"}

    def __str__(self) -> str:
        """Return the text for people: ``name:digest`` of each part."""
        return " ".join(f"{name}:{value}" for name, value in self.parts().items())

    @property
    def text(self) -> str:
        """The text that stores hold: that for people, and ``check``, a CRC-32 over it."""
        return f"{self} {_CHECK}:{_checked(str(self))}"

    @classmethod
    def parse(cls, text: str) -> Fingerprint:
        """Read what ``text`` gave.

        Raises:
            StoreError: if it is anything else.
        """
        plain, _, check = text[:_LONGEST].rpartition(f" {_CHECK}:")
        words = [word.partition(":") for word in plain.split(" ")]
        try:
            found = cls.from_parts({name: value for name, _, value in words})
        except StoreError:
            found = None
        if found is None or str(found) != plain or check != _checked(plain) or found.text != text:
            raise StoreError(f"{shown(text)} is no fingerprint, or is damaged")
        return found

    @classmethod
    def from_parts(cls, parts: Any) -> Fingerprint:
        """Read what ``parts`` gave, as a root attribute holds it.

        Raises:
            StoreError: if it is anything else.
        """
        names = {field.name for field in dataclasses.fields(cls)}
        is_whole = isinstance(parts, Mapping) and names - {"network"} <= set(parts) <= names
        if not is_whole:
            raise StoreError(f"fingerprint: got {shown(parts)}, valid: {', '.join(PARTS)}")
        return cls(**parts)


def fingerprint_of(attributes: Mapping[str, Any]) -> Fingerprint | None:
    """Return the fingerprint in a store's root attributes, or None if it is missing or invalid."""
    try:
        return Fingerprint.from_parts(attributes.get(FINGERPRINT))
    except StoreError:
        return None


def is_fingerprint(text: str) -> bool:
    """Say whether a row's text is one that ``Fingerprint.text`` gives."""
    return parsed(text) is not None


def parsed(text: str) -> Fingerprint | None:
    """Return the fingerprint that a row's text stands for; None where it stands for none."""
    try:
        return Fingerprint.parse(text)
    except StoreError:
        return None


def differing(a: Fingerprint, b: Fingerprint) -> tuple[str, ...]:
    """Return the names of the parts in which two fingerprints differ."""
    return tuple(name for name in PARTS if getattr(a, name) != getattr(b, name))


def meaning(parts: Iterable[str]) -> str:
    """Return some parts with what they are made from, for a message: ``engine (...) and ...``."""
    *most, last = (f"{name} ({PARTS[name]})" for name in parts)
    return f"{', '.join(most)} and {last}" if most else last


def difference(known: Fingerprint | None, here: Fingerprint) -> str:
    """Return in words how what is known of a platform differs from this one; empty if it does not.

    Args:
        known: where something was made; None where that is not told.
        here: this platform.
    """
    if known is None:
        return f"it was {NO_FINGERPRINT}"
    parts = differing(known, here)
    return f"the fingerprint differs in {meaning(parts)}" if parts else ""


def _checked(text: str) -> str:
    return f"{zlib.crc32(text.encode(errors='replace')):08x}"
