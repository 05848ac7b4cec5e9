"""The cache of imported objects and models; a file is checked by its hash when it is read."""

from __future__ import annotations

import contextlib
import hashlib
import os
import re
import time
from pathlib import Path
from uuid import uuid4

from grasp_factory.core.atomic_file import replacing
from grasp_factory.errors import UsageError, shown

VARIABLE = "GRASP_FACTORY_CACHE"
MAX_PATH = 900
"""Largest length of the directory's path, characters.

PyBullet 3.2.7 cuts the path of a mesh at 1024 characters, and a path that is not ASCII crashes the
process in ``createCollisionShapeArray``.
"""
_TOUCH_S = 86_400.0
"""Seconds after which a used file gets a new modification time."""
_SHA256 = re.compile(r"[0-9a-f]{64}")


def cache_dir() -> Path:
    """Return the cache's directory: ``$GRASP_FACTORY_CACHE``, or a folder in XDG's cache.

    Raises:
        UsageError: if no directory is found, or the physics engine cannot load meshes from it.
    """
    try:
        path = Path(os.environ.get(VARIABLE) or _user_cache() / "grasp-factory").absolute()
    except (OSError, RuntimeError) as error:
        raise UsageError(
            f"there is no place for the cache: {error}; set {VARIABLE} to a directory"
        ) from None
    if not str(path).isascii() or len(str(path)) > MAX_PATH:
        raise UsageError(
            f"the cache {shown(str(path))} cannot be used: the physics engine opens mesh files"
            f" by ASCII paths of up to {MAX_PATH} characters only; set {VARIABLE} to such a"
            " directory"
        )
    return path


def _user_cache() -> Path:
    base = Path(os.environ.get("XDG_CACHE_HOME", ""))
    return base if base.is_absolute() else Path("~/.cache").expanduser()


def digest(data: bytes) -> str:
    """Return the SHA-256 of some bytes, in hex."""
    return hashlib.sha256(data).hexdigest()


def is_digest(text: str) -> bool:
    """Return whether a text is a SHA-256 in hex; only such a text is used as a file name."""
    return _SHA256.fullmatch(text) is not None


def read_checked(path: Path) -> bytes | None:
    """Return the content of a file that is named by its hash; None if it is missing or damaged."""
    data = read(path)
    return data if data is not None and digest(data) == path.stem else None


def read(path: Path) -> bytes | None:
    """Return the content of a file, or None if it cannot be read."""
    try:
        return path.read_bytes()
    except OSError:
        return None


def write(path: Path, data: bytes) -> None:
    """Write a file of the cache atomically.

    Raises:
        UsageError: if it cannot be written.
    """
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        # A unique name: other processes may write the same file at this moment.
        with replacing(path, path.with_name(f".new-{uuid4().hex}")) as partial:
            partial.write_bytes(data)
    except OSError as error:
        why = error.strerror or str(error)
        raise UsageError(
            f"the cache {path.parent} cannot be written: {why}; set {VARIABLE} to a writable"
            " directory"
        ) from None


def touch(file: Path) -> None:
    """Note that a file of the cache is used: set its modification time, once a day."""
    with contextlib.suppress(OSError):
        if time.time() - file.stat().st_mtime > _TOUCH_S:
            os.utime(file)
