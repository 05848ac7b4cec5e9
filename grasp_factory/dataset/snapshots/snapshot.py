"""The record of a snapshot: what a store held, which snapshot came before, who took it and how."""

from __future__ import annotations

import hashlib
import json
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from grasp_factory.core.json_text import parsed
from grasp_factory.core.serialization import check, check_range, from_plain, to_plain
from grasp_factory.dataset.snapshots import segments
from grasp_factory.errors import ConfigError, StoreError

FORMAT, VERSION = "grasp-factory-snapshot", 1
LONGEST_MESSAGE, LONGEST_NAME, LONGEST_COMMAND = 4000, 255, 10_000
MOST_ARRAYS = 1000
_SHA256 = re.compile(r"[0-9a-f]{64}")
_TIME = re.compile(r"[0-9]{4}-[0-9]{2}-[0-9]{2}T[0-9]{2}:[0-9]{2}:[0-9]{2}\+00:00")


@dataclass(frozen=True, slots=True, kw_only=True)
class LogState:
    """The annotation log of a store: its bytes, and their SHA-256."""

    bytes: int
    sha256: str

    def __post_init__(self) -> None:
        check_range(self, "bytes", 1, 2**40)
        _check_sha256("sha256", self.sha256)


@dataclass(frozen=True, slots=True, kw_only=True)
class LabelState:
    """An added label: the SHA-256 of its outcomes, and its thresholds."""

    values_sha256: str
    thresholds: Mapping[str, Any]

    def __post_init__(self) -> None:
        _check_sha256("values_sha256", self.values_sha256)


@dataclass(frozen=True, slots=True, kw_only=True)
class StoreContents:
    """What a store holds. Equal stores have equal contents, wherever and whenever they are."""

    rows: int
    committed: int
    quarantined: int
    arrays: tuple[str, ...]
    """Paths of the arrays that have digests, in the order of the digests."""
    segments: tuple[str, ...]
    """SHA-256 of each segment's rows."""
    digests: tuple[str, ...]
    """SHA-256 of each segment's digests."""
    attributes: Mapping[str, Any]
    """Root attributes: config, seed, versions, platform, sources and others."""
    annotations: LogState | None = None
    labels: Mapping[str, LabelState] = field(default_factory=dict)
    embedded: Mapping[str, str] = field(default_factory=dict)
    """SHA-256 of embedded data, by path in the store."""

    def __post_init__(self) -> None:
        check_range(self, "rows", 0, 10**12)
        check_range(self, "committed", 0, self.rows)
        check_range(self, "quarantined", 0, self.rows - self.committed)
        check(len(self.arrays) <= MOST_ARRAYS, "arrays", len(self.arrays), f"up to {MOST_ARRAYS}")
        check(len(set(self.arrays)) == len(self.arrays), "arrays", "a path twice", "each once")
        for key in ("segments", "digests"):
            names, most = getattr(self, key), segments.count(self.rows)
            check(len(names) == most, key, len(names), f"{most} for {self.rows} rows")
            for name in names:
                _check_sha256(key, name)
        for name in self.embedded.values():
            _check_sha256("embedded", name)

    @property
    def rows_sha256(self) -> str:
        """The SHA-256 that names recipe, status and checksum of every row."""
        return named_rows(self.rows, self.segments)

    @property
    def sha256(self) -> str:
        """The SHA-256 that names all of it, also settings, labels and annotations."""
        return hashlib.sha256(canonical(to_plain(self))).hexdigest()


@dataclass(frozen=True, slots=True, kw_only=True)
class Snapshot:
    """A snapshot. Its id is the SHA-256 of its file, so it also names all snapshots before it."""

    parent: str | None
    """Id of the snapshot before; None for the first."""
    message: str
    who: str
    created: str
    """UTC, ISO 8601, seconds."""
    store: str
    """Name of the store's folder."""
    revision: str
    """Commit of the Git repository in which the command ran; empty without one."""
    command: str
    grasp_factory: str
    """Version that took the snapshot; the store's own versions are in its attributes."""
    contents: StoreContents
    format: str = FORMAT
    version: int = VERSION

    def __post_init__(self) -> None:
        check(self.format == FORMAT, "format", self.format, FORMAT)
        check(self.version == VERSION, "version", self.version, f"{VERSION}; install a newer one")
        if self.parent is not None:
            _check_sha256("parent", self.parent)
        for key, most in (
            ("message", LONGEST_MESSAGE),
            ("who", LONGEST_NAME),
            ("store", LONGEST_NAME),
            ("revision", LONGEST_NAME),
            ("command", LONGEST_COMMAND),
            ("grasp_factory", LONGEST_NAME),
        ):
            length = len(getattr(self, key))
            check(length <= most, key, f"{length} characters", f"up to {most}")
        check(bool(self.message.strip()), "message", self.message, "a text")
        check(bool(_TIME.fullmatch(self.created)), "created", self.created, "a time of UTC")

    def to_bytes(self) -> bytes:
        """Return the snapshot's file."""
        return canonical(to_plain(self)) + b"\n"

    @property
    def id(self) -> str:
        """The SHA-256 of the snapshot's file."""
        return hashlib.sha256(self.to_bytes()).hexdigest()


def named_rows(rows: int, names: Sequence[str]) -> str:
    """Return the SHA-256 that names the rows of segments with these names."""
    plain = {"rows": rows, "segments": list(names)}
    return hashlib.sha256(canonical(plain)).hexdigest()


def canonical(plain: Any) -> bytes:
    """Return plain data as JSON: equal data as equal bytes."""
    return json.dumps(plain, sort_keys=True, separators=(",", ":")).encode()


def snapshot_of(data: bytes, where: object) -> Snapshot:
    """Return the snapshot of a file.

    Raises:
        StoreError: if it has another content.
    """
    try:
        return from_plain(Snapshot, parsed(data))
    except (ConfigError, ValueError) as error:
        raise StoreError(f"{where} is no snapshot: {error}") from None


def is_sha256(text: str) -> bool:
    """Return whether a text is a SHA-256 in hexadecimal digits."""
    return _SHA256.fullmatch(text) is not None


def _check_sha256(key: str, got: str) -> None:
    check(is_sha256(got), key, got, "64 hexadecimal digits")
