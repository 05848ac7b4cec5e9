"""Messages between the importer and its child process: plain records and bytes.

The child receives the content of files, never their paths: it has no reason to open files.
"""

from __future__ import annotations

import json
import struct
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, BinaryIO

from grasp_factory.core.cache import digest
from grasp_factory.core.geometry import QuatXyzw, Vector3
from grasp_factory.core.serialization import to_plain
from grasp_factory.objects.folder import Geometry

IMPORTER = 2
"""Version of the conversion; cached results of other versions are not used."""
_LENGTH = struct.Struct("<Q")


@dataclass(frozen=True, slots=True, kw_only=True)
class Shape:
    """A primitive or a mesh in the frame of its object."""

    kind: str
    """One of ``PRIMITIVES`` or ``MESH_SUFFIXES``."""
    size: Vector3
    """For a primitive, its sides, metres; for a mesh, the scale per axis."""
    position: Vector3 = (0.0, 0.0, 0.0)
    quat_xyzw: QuatXyzw = (0.0, 0.0, 0.0, 1.0)
    blob: int = -1
    """Index of the mesh among the job's files; -1 for a primitive."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Job:
    """An object to convert."""

    collision: tuple[Shape, ...]
    visual: tuple[Shape, ...] = ()
    """The visual shapes; if empty, the collision shapes are rendered."""
    guess_units: bool = False
    """Whether the meshes' unit is unknown and must be guessed."""

    def key(self, blobs: Sequence[bytes]) -> str:
        """Return the SHA-256 of everything that the result depends on."""
        parts = [IMPORTER, to_plain(self), [digest(blob) for blob in blobs]]
        return digest(json.dumps(parts, sort_keys=True).encode())


@dataclass(frozen=True, slots=True, kw_only=True)
class Converted:
    """A converted object; its files are in the cache."""

    geometry: Geometry
    volume: float
    """m3."""
    sides: Vector3
    """As in ``ImportedObject``."""
    color: Vector3 | None = None
    """Mean of the colours in the meshes."""
    warnings: tuple[str, ...] = ()


def encode(header: Mapping[str, Any], blobs: Sequence[bytes] = ()) -> bytes:
    """Return one message: its length, its header's length, the header as JSON, the blobs."""
    text = json.dumps({**header, "sizes": [len(blob) for blob in blobs]}).encode()
    length = _LENGTH.size + len(text) + sum(len(blob) for blob in blobs)
    return b"".join([_LENGTH.pack(length), _LENGTH.pack(len(text)), text, *blobs])


def message_length(start: bytes) -> int | None:
    """Return a message's length in bytes, read from its first bytes; None if these are too few."""
    if len(start) < _LENGTH.size:
        return None
    return _LENGTH.size + int(_LENGTH.unpack_from(start)[0])


def decode(message: bytes) -> tuple[dict[str, Any], list[bytes]]:
    """Return the header and the blobs of a whole message."""
    at = 2 * _LENGTH.size
    end = at + int(_LENGTH.unpack_from(message, _LENGTH.size)[0])
    header = json.loads(message[at:end])
    blobs = []
    for size in header.pop("sizes"):
        blobs.append(message[end : end + size])
        end += size
    return header, blobs


def receive(stream: BinaryIO) -> bytes:
    """Return the next message of a stream; empty when it has ended."""
    start = stream.read(_LENGTH.size)
    length = message_length(start)
    return start + stream.read(length - len(start)) if length else b""
