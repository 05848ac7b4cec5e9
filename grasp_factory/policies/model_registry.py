"""Import of trained models into this machine's cache, and loading them by their SHA-256."""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path

from grasp_factory.core.cache import cache_dir, digest, is_digest, read_checked, write
from grasp_factory.core.optional import require
from grasp_factory.errors import ConfigError, UsageError, shown
from grasp_factory.policies.networks import GraspModel, load_model

MAX_BYTES = 2**30
"""Largest size of a model's file."""
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
        with file.open("rb") as opened:
            data = opened.read(MAX_BYTES + 1)
    except OSError as error:
        raise UsageError(f"{file} cannot be read: {error.strerror or error}") from None
    if len(data) > MAX_BYTES:
        raise UsageError(f"{file} has more than {MAX_BYTES} bytes, so it is no model of grasps")
    try:
        load_model(data)
    except UsageError as error:
        raise UsageError(f"{file}: {error}") from None
    return keep(data)


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
