"""Import of trained models into this machine's cache, and loading them by their SHA-256."""

from __future__ import annotations

import os
import stat
from functools import lru_cache
from pathlib import Path

from grasp_factory.core.cache import cache_dir, digest, is_digest, read_checked, write
from grasp_factory.core.limits import EMBEDDED
from grasp_factory.core.optional import require
from grasp_factory.errors import ConfigError, UsageError, shown
from grasp_factory.policies.networks import GraspModel, load_model

MAX_BYTES = EMBEDDED.usual
"""Largest size of a model's file: a store contains its model."""
_LOADED = 4
"""Number of models that a process keeps in memory."""


def import_model(file: Path) -> str:
    """Copy a model's file into the cache and return its SHA-256.

    Raises:
        UsageError: if the file cannot be read or is not a model that can rank grasps, or if torch
            or safetensors is not installed.
    """
    require("torch", "safetensors", extra="train")
    try:
        with open(file, "rb", opener=_opener) as opened:
            found = os.fstat(opened.fileno())
            is_model = stat.S_ISREG(found.st_mode) and found.st_size <= MAX_BYTES
            data = opened.read() if is_model else b""
    except OSError as error:
        raise UsageError(f"{file} cannot be read: {error.strerror or error}") from None
    if not is_model:
        valid = f"valid: a regular file of up to {MAX_BYTES} bytes"
        raise UsageError(f"{file} is no model of grasps, {valid}")
    try:
        load_model(data)
    except UsageError as error:
        raise UsageError(f"{file}: {error}") from None
    return keep(data)


def _opener(file: str, flags: int) -> int:
    """Open a file that may be a pipe, without waiting for its writer."""
    return os.open(file, flags | os.O_NONBLOCK)


def keep(data: bytes) -> str:
    """Write the bytes of a model's file into the cache and return their SHA-256.

    Raises:
        UsageError: if the cache cannot be written.
    """
    sha256 = digest(data)
    write(_path(sha256), data)
    return sha256


def read(sha256: str) -> bytes:
    """Return the bytes of an imported model's file.

    Raises:
        ConfigError: if the file is missing or damaged in this machine's cache.
    """
    data = read_checked(_path(sha256)) if is_digest(sha256) else None
    if data is None:
        raise ConfigError(
            f"the cache {cache_dir()} has no trained model with the SHA-256 {shown(sha256)}; give"
            " its file with --model FILE"
        )
    return data


@lru_cache(maxsize=_LOADED)
def find_model(sha256: str) -> GraspModel:
    """Return an imported model; repeated calls in a process return the same one.

    Raises:
        ConfigError: if the file is missing or damaged in this machine's cache.
        UsageError: if it is not a model that can rank grasps, or if torch or safetensors is not
            installed.
    """
    return load_model(read(sha256))


def _path(sha256: str) -> Path:
    return cache_dir() / "models" / f"{sha256}.safetensors"
