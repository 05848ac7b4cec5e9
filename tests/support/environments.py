"""Virtual environments whose libraries are links to those of this one."""

from __future__ import annotations

import sysconfig
import venv
from pathlib import Path

PYBULLET = ("pybullet", "eglRenderer")
"""How the names begin of all that PyBullet installs."""


def environment(folder: Path, without: tuple[str, ...]) -> Path:
    """Make a virtual environment and return its Python.

    Args:
        folder: where, new.
        without: how the names of the files begin that it does not get.
    """
    venv.create(folder)
    for ours in {sysconfig.get_path("purelib"), sysconfig.get_path("platlib")}:
        for file in Path(ours).iterdir():
            if not file.name.startswith(without):
                (site_packages(folder) / file.name).symlink_to(file)
    return folder / "bin" / "python"


def site_packages(folder: Path) -> Path:
    """Return where the libraries of a virtual environment are."""
    return Path(sysconfig.get_path("purelib", "venv", {"base": str(folder)}))
