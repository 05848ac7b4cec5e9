"""URDF files for Rerun's loader: absolute paths of meshes, and only what is visible."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from xml.etree import ElementTree
from xml.etree.ElementTree import Element, SubElement

import rerun as rr
from rerun.urdf import UrdfTree

from grasp_factory.core.package_files import SCHEME, package_folders

_UNSEEN = ("collision", "contact", "inertial")


def log_urdf(
    recording: rr.RecordingStream,
    path: Path,
    folder: Path,
    entity: str,
    color: Sequence[float] | None = None,
) -> UrdfTree:
    """Log the links of a URDF file, with frames named ``<entity>/<link>``; return it.

    Args:
        recording: The recording to log to.
        path: The URDF file.
        folder: Folder in which a file for the loader may be written.
        entity: Name of the entity that contains the links.
        color: RGB, 0 to 1, instead of the file's.
    """
    file = folder / f"{entity}.urdf"
    file.write_bytes(seen_urdf(path, color))
    tree = UrdfTree.from_file_path(
        file,
        entity_path_prefix=entity,
        frame_prefix=f"{entity}/",
        static_transform_entity_path=f"/{entity}/joints",
    )
    tree.log_urdf_to_recording(recording)
    return tree


def seen_urdf(path: Path, color: Sequence[float] | None = None) -> bytes:
    """Return a URDF file with absolute mesh paths and only the elements that are visible.

    If a link's mesh belongs to a package that is not installed, its collision shape is shown.
    """
    robot = ElementTree.parse(path).getroot()
    for link in robot.findall("link"):
        _show_collisions_for_missing(link, path.parent)
        for part in [part for part in link if part.tag in _UNSEEN]:
            link.remove(part)
        for visual in link.findall("visual"):
            for mesh in visual.iter("mesh"):
                mesh.set("filename", str(_found(mesh.get("filename", ""), path.parent)))
            if color is not None:
                _paint(visual, color)
    return ElementTree.tostring(robot)


def _show_collisions_for_missing(link: Element, folder: Path) -> None:
    """Show a link by its collision shapes, in its colour, if a visual mesh is missing."""
    visuals = link.findall("visual")
    meshes = [mesh.get("filename", "") for visual in visuals for mesh in visual.iter("mesh")]
    if all(_found(name, folder).is_file() for name in meshes):
        return
    material = visuals[0].find("material")
    for visual in visuals:
        link.remove(visual)
    for shape in link.findall("collision"):
        shape.tag = "visual"
        if material is not None:
            shape.append(material)


def _paint(visual: Element, color: Sequence[float]) -> None:
    for material in visual.findall("material"):
        visual.remove(material)
    material = SubElement(visual, "material", name="drawn")
    SubElement(material, "color", rgba=" ".join(f"{value:.6g}" for value in (*color, 1.0)))


def _found(name: str, folder: Path) -> Path:
    """Return the path of a mesh's file, by the same rules as the physics engine."""
    for package, place in (package_folders() | {SCHEME: folder}).items():
        if name.startswith(package):
            return place / name.removeprefix(package)
    return folder / name
