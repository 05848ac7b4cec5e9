"""The plain form of the OBJ files that imports write, and a check that a file has it.

On other files the engine's loader could fail, or read a file that they refer to.
"""

from __future__ import annotations

import re

import numpy as np

from grasp_factory.core.geometry import Array
from grasp_factory.errors import StoreError
from grasp_factory.objects.base import MAX_HULLS
from grasp_factory.objects.folder import MAX_REACH

MAX_NUMBER = 2.0 * MAX_REACH
"""Largest number in a mesh; a visual shape may extend a little beyond the collision shape."""
_NUMBER = rb"-?\d{1,20}(?:\.\d{1,20})?(?:e-?\d{1,3})?"
_MESH = re.compile(
    rb"(?:"
    rb"o \w{1,40}\n"
    rb"|vn?(?: " + _NUMBER + rb"){3}\n"
    rb"|vt(?: " + _NUMBER + rb"){2}\n"
    rb"|f(?: \d{1,9}){3}\n"
    rb"|f(?: \d{1,9}/\d{1,9}/\d{1,9}){3}\n"
    rb")*+"
)
_GROUP = re.compile(rb"^o ", re.MULTILINE)
_POSITION, _TEXTURE, _NORMAL = (
    re.compile(rb"^" + kind + rb" (.*)$", re.MULTILINE) for kind in (b"v", b"vt", b"vn")
)
_FACE = re.compile(rb"^f (\d+ .*)$", re.MULTILINE)
_FULL_FACE = re.compile(rb"^f (\d+/.*)$", re.MULTILINE)


def check_plain_mesh(name: str, data: bytes) -> None:
    """Check that a mesh has the plain form, and that its faces have vertices.

    Raises:
        StoreError: saying what is wrong with the mesh of this name.
    """
    if not _MESH.fullmatch(data):
        raise StoreError(f"mesh {name} has lines that imports do not write")
    groups = len(_GROUP.findall(data))
    if groups > MAX_HULLS:
        raise StoreError(f"mesh {name} has {groups} groups, valid: up to {MAX_HULLS}")
    tables = [_numbers(_POSITION, data, 3), _numbers(_TEXTURE, data, 2), _numbers(_NORMAL, data, 3)]
    if any(np.abs(table).max(initial=0.0) > MAX_NUMBER for table in tables):
        raise StoreError(f"mesh {name} has numbers that no object has")
    corners, full = _numbers(_FACE, data, 1), _numbers(_FULL_FACE, data, 3)
    if not len(corners) + len(full):
        raise StoreError(f"mesh {name} has no faces")
    used = [np.append(corners, full[:, 0]), full[:, 1], full[:, 2]]
    for table, indices in zip(tables, used, strict=True):
        if np.any((indices < 1) | (indices > len(table))):
            raise StoreError(f"mesh {name} has a face without vertices")


def _numbers(lines: re.Pattern[bytes], data: bytes, columns: int) -> Array:
    """Return the numbers in some lines, (n, columns)."""
    words = b" ".join(lines.findall(data)).replace(b"/", b" ")
    return np.fromstring(words, sep=" ").reshape(-1, columns)
