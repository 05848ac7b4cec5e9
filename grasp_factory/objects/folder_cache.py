"""Where the parts of an imported folder lie in this machine's cache."""

from __future__ import annotations

from pathlib import Path


def mesh_path(cache: Path, sha256: str) -> Path:
    """Return where the OBJ file with that content lies, or would."""
    return cache / "meshes" / f"{sha256}.obj"


def manifest_path(cache: Path, sha256: str) -> Path:
    """Return where the manifest with that digest lies, or would."""
    return cache / "folders" / f"{sha256}.json"
