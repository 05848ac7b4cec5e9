"""The foot of a robot: the link that stands on the table and never moves."""

from __future__ import annotations

from functools import cache
from pathlib import Path
from xml.etree import ElementTree

from grasp_factory.core.package_files import SCHEME
from grasp_factory.simulation.world.memory import file_in_memory
from grasp_factory.simulation.world.urdf import with_packages


@cache
def foot_of(path: Path) -> Path:
    """Return a URDF with only the root link of ``path``, in memory until the process ends."""
    root = ElementTree.parse(with_packages(path)).getroot()
    children = {child.attrib["link"] for child in root.iterfind("joint/child")}
    for element in [*root.iterfind("joint"), *root.iterfind("link")]:
        if element.tag == "joint" or element.attrib["name"] in children:
            root.remove(element)
    for mesh in root.iter("mesh"):
        mesh.attrib["filename"] = _absolute(mesh.attrib["filename"], path.parent)
    return Path(file_in_memory(f"foot of {path.name}", ElementTree.tostring(root)))


def _absolute(mesh: str, folder: Path) -> str:
    return str(folder / mesh.removeprefix(SCHEME))
