"""URDF files as the engine's loader can take them."""

from __future__ import annotations

import os
from functools import cache
from pathlib import Path

from grasp_factory.world.engine import DATA


@cache
def with_packages(path: Path) -> str:
    """Return a file for the loader, which finds meshes by absolute path only.

    The file lives in memory as long as the process: a killed worker leaves nothing behind, and
    no other content can come under its name, for the loader caches files by name.
    """
    text = path.read_text(encoding="utf-8")
    if "package://pybullet_data/" not in text:
        return str(path)
    file = os.memfd_create(path.name)
    os.write(file, text.replace("package://pybullet_data", str(DATA)).encode())
    return f"/proc/self/fd/{file}"
