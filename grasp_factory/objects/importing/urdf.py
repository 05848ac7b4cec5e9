"""Parse a URDF file: one rigid body, its shapes, mass, inertia, friction and colour."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from xml.etree.ElementTree import Element

import numpy as np

from grasp_factory.core.elementary import LARGEST_ANGLE
from grasp_factory.core.geometry import Array, Pose, Vector3, apply, rotation_of_rpy, transform
from grasp_factory.core.linear import total
from grasp_factory.errors import shown
from grasp_factory.objects.importing.base import UnusableError
from grasp_factory.objects.importing.folder_listing import suffix
from grasp_factory.objects.importing.messages import Shape
from grasp_factory.objects.importing.references import parse_xml

MAX_ELEMENTS = 256
"""Largest number of links, of joints, and of each kind of shape of a link."""
MAX_SHAPES = 128
"""Largest number of collision shapes, and of visual shapes."""
MAX_MESHES = 64
"""Largest number of mesh file names."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Inertial:
    """The mass distribution that a URDF states."""

    com: Vector3
    """Metres, in the object's frame."""
    inertia: Array
    """(3, 3) kg m2 about the centre of mass, in the axes of the object's frame."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Urdf:
    """A rigid body; its frame is that of the root link."""

    collision: tuple[Shape, ...]
    visual: tuple[Shape, ...]
    files: tuple[str, ...]
    """Names of its meshes in the URDF; a shape's ``blob`` is an index here."""
    mass: float | None
    """kg, of all links; None if no link has a mass above 0."""
    inertial: Inertial | None
    """None unless exactly one link has an inertia, and exactly one a mass above 0."""
    friction: float | None
    color: Vector3 | None
    warnings: tuple[str, ...] = ()


def parse_urdf(data: bytes) -> Urdf:
    """Return the rigid body that a URDF's text describes.

    Raises:
        UnusableError: if it is not a URDF, or not one rigid body.
    """
    root = parse_xml(data)
    if root.tag != "robot":
        raise UnusableError(f"it is no URDF: its outermost element is {shown(root.tag)}")
    links = _named(root, "link")
    poses = _poses(links, _elements(root, "joint"))
    files: dict[str, int] = {}
    shapes: dict[str, list[Shape]] = {"collision": [], "visual": []}
    for name, link in links.items():
        for kind, found in shapes.items():
            for element in _elements(link, kind):
                T = poses[name] @ _origin(element)
                found.append(_shape(element, T, files))
                if len(found) > MAX_SHAPES:
                    raise UnusableError(f"it has more than {MAX_SHAPES} {kind} shapes")
    collision = tuple(shapes["collision"] or shapes["visual"])
    if not collision:
        raise UnusableError("it has no shapes")
    masses = [mass for link in links.values() if (mass := _mass(link)) is not None]
    known = [mass for mass in masses if mass > 0.0]
    inertials = [_inertial(link, poses[name]) for name, link in links.items()]
    valid = [one for one in inertials if one is not None]
    return Urdf(
        collision=collision,
        visual=tuple(shapes["visual"]) if shapes["collision"] else (),
        files=tuple(files),
        mass=total(known) or None,
        inertial=valid[0] if len(valid) == len(known) == 1 else None,
        friction=_friction(links),
        color=_color(root, links),
        warnings=tuple(
            dict.fromkeys(f"a mass of {mass:g} kg is left aside" for mass in masses if mass <= 0.0)
        ),
    )


def _named(root: Element, tag: str) -> dict[str, Element]:
    found = {}
    for element in _elements(root, tag):
        name = element.get("name", "")
        if not name or name in found:
            raise UnusableError(f"it has a {tag} without a name of its own: {shown(name)}")
        found[name] = element
    if not found:
        raise UnusableError(f"it has no {tag}")
    return found


def _elements(parent: Element, tag: str) -> list[Element]:
    found = parent.findall(tag)
    if len(found) > MAX_ELEMENTS:
        raise UnusableError(f"it has more than {MAX_ELEMENTS} elements {tag}")
    return found


def _poses(links: Mapping[str, Element], joints: list[Element]) -> dict[str, Array]:
    """Return each link's pose in the frame of the root link, (4, 4)."""
    parents: dict[str, tuple[str, Array]] = {}
    for joint in joints:
        kind = joint.get("type")
        if kind != "fixed":
            raise UnusableError(f"it has a joint that moves ({shown(kind)}): it is not one body")
        ends = [_child(joint, tag).get("link", "") for tag in ("parent", "child")]
        if not all(end in links for end in ends) or ends[1] in parents:
            raise UnusableError("its joints do not join its links to a tree")
        parents[ends[1]] = ends[0], _origin(joint)
    roots = [name for name in links if name not in parents]
    if len(roots) != 1:
        raise UnusableError(f"it has {len(roots)} bodies that no joint holds, valid: 1")
    poses = {roots[0]: np.eye(4)}
    todo = dict(parents)
    while todo:
        ready = [name for name, (parent, _) in todo.items() if parent in poses]
        if not ready:
            raise UnusableError("its joints go round in a circle")
        for name in ready:
            parent, T = todo.pop(name)
            poses[name] = poses[parent] @ T
    return poses


def _shape(element: Element, T: Array, files: dict[str, int]) -> Shape:
    geometry = _child(element, "geometry")
    pose = Pose.from_matrix(T)
    found = list(geometry)
    kind = found[0].tag if len(found) == 1 else ""
    blob = -1
    if kind == "box":
        size = _numbers(found[0], "size", "")
    elif kind == "sphere":
        size = (2.0 * _number(found[0], "radius"),) * 3
    elif kind in ("cylinder", "capsule"):
        width = 2.0 * _number(found[0], "radius")
        caps = width if kind == "capsule" else 0.0
        size = (width, width, _number(found[0], "length") + caps)
    elif kind == "mesh":
        size = _numbers(found[0], "scale", "1 1 1")
        name = found[0].get("filename", "")
        blob, kind = files.setdefault(name, len(files)), suffix(name)
        if len(files) > MAX_MESHES:
            raise UnusableError(f"it names more than {MAX_MESHES} meshes")
    else:
        raise UnusableError(
            f"it has a shape {shown(kind)}, valid: box, sphere, cylinder, capsule, mesh"
        )
    ok = all(side != 0.0 if blob >= 0 else 0.0 < side <= 2.0 for side in size)
    if not ok:
        raise UnusableError(f"it has a {kind} of the size {shown(size)}")
    return Shape(kind=kind, size=size, position=pose.position, quat_xyzw=pose.quat_xyzw, blob=blob)


def _mass(link: Element) -> float | None:
    element = link.find("inertial/mass")
    return None if element is None else _number(element, "value")


def _inertial(link: Element, T: Array) -> Inertial | None:
    inertial = link.find("inertial")
    element = None if inertial is None else inertial.find("inertia")
    if inertial is None or element is None:
        return None
    xx, yy, zz, xy, xz, yz = (
        _number(element, key) if key in element.attrib or key[1] == key[2] else 0.0
        for key in ("ixx", "iyy", "izz", "ixy", "ixz", "iyz")
    )
    local = T @ _origin(inertial)
    R = local[:3, :3]
    x, y, z = (float(v) for v in apply(local, np.zeros(3)))
    inertia = R @ np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]) @ R.T
    return Inertial(com=(x, y, z), inertia=inertia)


def _friction(links: Mapping[str, Element]) -> float | None:
    for link in links.values():
        element = link.find("contact/lateral_friction")
        if element is not None:
            return _number(element, "value")
    return None


def _color(root: Element, links: Mapping[str, Element]) -> Vector3 | None:
    known = {material.get("name", ""): material for material in root.findall("material")}
    for link in links.values():
        for material in link.findall("visual/material"):
            for one in (material, known.get(material.get("name", ""))):
                color = None if one is None else one.find("color")
                if color is not None:
                    red, green, blue, *_ = (
                        min(1.0, max(0.0, v)) for v in _floats(color, "rgba", "1 1 1 1", 4)
                    )
                    return red, green, blue
    return None


def _origin(element: Element) -> Array:
    """Return the transform (4, 4) of an element's ``origin``; its angles are about fixed axes."""
    origin = element.find("origin")
    if origin is None:
        return np.eye(4)
    rpy = _numbers(origin, "rpy", "0 0 0")
    if max(map(abs, rpy)) > LARGEST_ANGLE:
        raise UnusableError(
            f"it has an origin with rpy {rpy}: valid: {LARGEST_ANGLE:g} rad at most"
        )
    return transform(rotation_of_rpy(rpy), _numbers(origin, "xyz", "0 0 0"))


def _child(element: Element, tag: str) -> Element:
    child = element.find(tag)
    if child is None:
        raise UnusableError(f"it has a {element.tag} without {tag}")
    return child


def _number(element: Element, key: str) -> float:
    return next(iter(_floats(element, key, "", 1)))


def _numbers(element: Element, key: str, default: str) -> Vector3:
    x, y, z = _floats(element, key, default, 3)
    return x, y, z


def _floats(element: Element, key: str, default: str, count: int) -> Iterator[float]:
    text = element.get(key, default)
    try:
        values = [float(word) for word in text.split()]
    except ValueError:
        values = []
    if len(values) != count or not all(math.isfinite(v) and abs(v) < 1e9 for v in values):
        raise UnusableError(f"its {element.tag} has {key} {shown(text)}, valid: {count} numbers")
    return iter(values)
