"""Files of installed packages, found without importing the packages."""

from __future__ import annotations

from functools import cache
from importlib.util import find_spec
from pathlib import Path

from grasp_factory.core.optional import require_pybullet

SCHEME = "package://"
"""ROS's scheme for a file of a package, as URDF files use it: ``package://NAME/path``."""
PACKAGES = ("pybullet_data", "grasp_factory")
"""The packages that the URDF files of this project refer to."""


@cache
def folder_of(package: str) -> Path:
    """Return the folder of an installed package, one of ``PACKAGES``.

    Raises:
        MissingLibraryError: if PyBullet, which brings ``pybullet_data``, is not installed.
    """
    if package == "pybullet_data":
        require_pybullet()
    found = find_spec(package)
    assert found is not None and found.origin is not None
    return Path(found.origin).parent


def package_folders() -> dict[str, Path]:
    """Return the folders of the installed ``PACKAGES`` by the prefixes that URDF files use."""
    there = [package for package in PACKAGES if find_spec(package) is not None]
    return {f"{SCHEME}{package}/": folder_of(package) for package in there}
