"""PyBullet, imported without its start message, and a context manager that mutes its output."""

from __future__ import annotations

import contextlib
import ctypes
import os
from collections.abc import Iterator
from pathlib import Path

from grasp_factory.core.optional import require_pybullet
from grasp_factory.errors import MissingLibraryError

_LIBC = ctypes.CDLL(None)


@contextlib.contextmanager
def muted(fd: int) -> Iterator[None]:
    """Discard the output to a file descriptor: the library prints from C, not by ``sys.stdout``."""
    saved = os.dup(fd)
    try:
        _LIBC.fflush(None)
        with open(os.devnull, "wb") as nowhere:
            os.dup2(nowhere.fileno(), fd)
        yield
    finally:
        _LIBC.fflush(None)  # C buffers its output to a pipe
        os.dup2(saved, fd)
        os.close(saved)


require_pybullet()
with muted(2):  # "pybullet build time: ..."
    import pybullet as p
    import pybullet_data

if not p.isNumpyEnabled():
    raise MissingLibraryError(
        "this pybullet was built without numpy and makes no images: pip install numpy setuptools"
        " wheel, then pip install --no-build-isolation --no-cache-dir --force-reinstall --no-deps"
        " pybullet==3.2.7"
    )

DATA = Path(pybullet_data.getDataPath())

__all__ = ["DATA", "muted", "p"]
