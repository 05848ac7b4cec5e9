"""Paths of an imported folder's files in this machine's cache."""

from __future__ import annotations

from pathlib import Path


def mesh_path(cache: Path, sha256: str) -> Path:
    """Return the path of the OBJ file with that digest, whether it exists or not."""
    return cache / "meshes" / f"{sha256}.obj"


def manifest_path(cache: Path, sha256: str) -> Path:
    """Return the path of the manifest with that digest, whether it exists or not."""
    return cache / "folders" / f"{sha256}.json"
