"""Fingerprints of platforms: their parts, their text form, and how two of them differ."""

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
"""Part of a fingerprint to a description of the results that it is computed from."""
FINGERPRINT = "fingerprint"
"""Root attribute of a store with the parts; stores have it since version 0.5.0."""
ACCEPT = "--accept-other-platform"
NO_FINGERPRINT = "made by a version without fingerprints"
_CHECK = "check"
_DIGEST = re.compile(r"[0-9a-f]{8}")
_LONGEST = 200


@dataclass(frozen=True, slots=True, kw_only=True)
class Fingerprint:
    """Digests of results that a platform computes; equal fingerprints mean equal bytes of episodes.

    Each part has 8 hexadecimal digits.
    """

    engine: str
    images: str
    libm: str
    arithmetic: str
    network: str = ""
    """Empty if no trained model is used for the episodes."""

    def __post_init__(self) -> None:
        """Check the parts.

        Raises:
            StoreError: naming a part that is not a digest.
        """
        for name, value in self.parts().items():
            if not isinstance(value, str) or not _DIGEST.fullmatch(value):
                valid = "8 hexadecimal digits"
                raise StoreError(f"fingerprint: {name}: got {shown(value)}, valid: {valid}")

    def parts(self) -> dict[str, str]:
        """Return the parts by name, without an empty ``network``."""
        found = {field.name: getattr(self, field.name) for field in dataclasses.fields(self)}
        return {name: value for name, value in found.items() if value or name != "network"}

    def __str__(self) -> str:
        """Return ``name:digest`` of each part, for people to read."""
        return " ".join(f"{name}:{value}" for name, value in self.parts().items())

    @property
    def text(self) -> str:
        """The text in the rows of a store: ``str(self)`` and ``check``, a CRC-32 of it."""
        return f"{self} {_CHECK}:{_checked(str(self))}"

    @classmethod
    def parse(cls, text: str) -> Fingerprint:
        """Return the fingerprint with this ``text``.

        Raises:
            StoreError: if the text is invalid or damaged.
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
        """Return the fingerprint with these ``parts``, as a root attribute has them.

        Raises:
            StoreError: if they are invalid.
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
    """Return whether a row's text is a valid ``Fingerprint.text``."""
    return parsed(text) is not None


def parsed(text: str) -> Fingerprint | None:
    """Return the fingerprint with a row's text, or None if the text is invalid."""
    try:
        return Fingerprint.parse(text)
    except StoreError:
        return None


def differing(a: Fingerprint, b: Fingerprint) -> tuple[str, ...]:
    """Return the names of the parts in which two fingerprints differ."""
    return tuple(name for name in PARTS if getattr(a, name) != getattr(b, name))


def meaning(parts: Iterable[str]) -> str:
    """Return names of parts with their descriptions, for a message: ``engine (...) and ...``."""
    *most, last = (f"{name} ({PARTS[name]})" for name in parts)
    return f"{', '.join(most)} and {last}" if most else last


def difference(known: Fingerprint | None, here: Fingerprint) -> str:
    """Return in words how two platforms differ; empty if they do not.

    Args:
        known: the platform that made something; None if it is unknown.
        here: this platform.
    """
    if known is None:
        return f"it was {NO_FINGERPRINT}"
    parts = differing(known, here)
    return f"the fingerprint differs in {meaning(parts)}" if parts else ""


def _checked(text: str) -> str:
    return f"{zlib.crc32(text.encode(errors='replace')):08x}"
