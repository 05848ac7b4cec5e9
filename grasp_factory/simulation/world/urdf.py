"""Convert URDF files to what the engine's loader accepts."""

from __future__ import annotations

import os
from functools import cache
from pathlib import Path
from xml.etree import ElementTree

from grasp_factory.core.package_files import package_folders
from grasp_factory.errors import RecipeError
from grasp_factory.simulation.world.memory import file_in_memory


@cache
def with_packages(path: Path) -> str:
    """Return the path of a file for the loader, which finds meshes by absolute path only."""
    text = path.read_text(encoding="utf-8")
    found = text
    for prefix, folder in package_folders().items():
        if prefix in text:
            found = found.replace(prefix, f"{_plain_name(folder)}/")
    if found == text:
        return str(path)
    return file_in_memory(path.name, _without_frames(found))


def _without_frames(text: str) -> bytes:
    """Return a URDF without the empty links, which only name a frame.

    Each of them would cost the engine 1.6 microseconds per step.

    Raises:
        RecipeError: if a joint of such a link has a rotation; no file of this package has one.
    """
    robot = ElementTree.fromstring(text)
    joints = robot.findall("joint")
    for link in [link for link in robot.findall("link") if not len(link)]:
        joint = next(j for j in joints if _end(j, "child").get("link") == link.get("name"))
        shift = _shift(joint)
        for below in joints:
            if _end(below, "parent").get("link") == link.get("name"):
                _end(below, "parent").set("link", _end(joint, "parent").get("link", ""))
                moved = [a + b for a, b in zip(shift, _shift(below), strict=True)]
                _end(below, "origin").set("xyz", " ".join(f"{v:.17g}" for v in moved))
        robot.remove(link)
        robot.remove(joint)
        joints.remove(joint)
    return ElementTree.tostring(robot)


def _end(joint: ElementTree.Element, kind: str) -> ElementTree.Element:
    found = joint.find(kind)
    assert found is not None
    return found


def _shift(joint: ElementTree.Element) -> list[float]:
    origin = _end(joint, "origin")
    if any(float(v) for v in origin.get("rpy", "0 0 0").split()):
        raise RecipeError(
            f"joint {joint.get('name')} of an empty link has a rotation, valid: rpy 0 0 0: remove"
            " the rotation, or give the link an inertial element"
        )
    return [float(v) for v in origin.get("xyz", "0 0 0").split()]


@cache
def _plain_name(directory: Path) -> str:
    """Return an ASCII name for any directory: the engine accepts no other names."""
    return f"/proc/self/fd/{os.open(directory, os.O_PATH)}"
