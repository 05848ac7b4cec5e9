"""Parse the XML of a URDF, and find the files in the folder that its meshes may be."""

from __future__ import annotations

import posixpath
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

from grasp_factory.core.package_files import SCHEME
from grasp_factory.errors import shown
from grasp_factory.objects.importing.base import UnusableError
from grasp_factory.objects.importing.file_kinds import MESH_SUFFIXES
from grasp_factory.objects.importing.folder_listing import suffix

MAX_TEXT = 4 * 2**20
"""Bytes of a URDF."""


def named_meshes(data: bytes) -> tuple[str, ...]:
    """Return the mesh names in an unusable URDF; none if it cannot be parsed."""
    try:
        found = (mesh.get("filename", "") for mesh in parse_xml(data).iter("mesh"))
        return tuple(dict.fromkeys(found))
    except UnusableError:
        return ()


def mesh_file(reference: str, urdf: str) -> tuple[str, ...]:
    """Return the relative paths where a mesh may be in the folder, the most likely first.

    Args:
        reference: its name in the URDF; a package is a folder of that name, or the root.
        urdf: the URDF's own path in the folder.

    Raises:
        UnusableError: if it is outside of the folder, or has another format.
    """
    kind = suffix(reference)
    if kind not in MESH_SUFFIXES:
        raise UnusableError(f"its mesh {shown(reference)} is no {', '.join(MESH_SUFFIXES)} file")
    path = reference.replace("\\", "/")
    here = posixpath.dirname(urdf)
    if path.startswith(SCHEME):
        path = path.removeprefix(SCHEME)
        rest = path.partition("/")[2]
        options = [path, rest, posixpath.join(here, rest), posixpath.join(here, "..", rest)]
    elif "://" in path or path.startswith(("/", "~", "file:")):
        options = []
    else:
        options = [posixpath.join(here, path)]
    inside = [posixpath.normpath(option) for option in options]
    inside = [p for p in inside if p != "." and not p.startswith(("/", "..")) and "\0" not in p]
    if not inside:
        raise UnusableError(f"its mesh {shown(reference)} lies outside the folder")
    return tuple(dict.fromkeys(inside))


def parse_xml(data: bytes) -> Element:
    """Return the root element of an XML text that has no entities.

    Raises:
        UnusableError: if it is too long, not UTF-8, not XML, or has entities.
    """
    if len(data) > MAX_TEXT:
        raise UnusableError(f"it has more than {MAX_TEXT // 2**20} MiB of text")
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError:
        raise UnusableError("it is not UTF-8 text") from None
    # For a str the parser ignores the stated encoding, so no encoding can hide these words.
    if "<!DOCTYPE" in text or "<!ENTITY" in text:
        raise UnusableError("it declares a document type or entities, which no URDF needs")
    try:
        return ElementTree.fromstring(text)
    except (ElementTree.ParseError, ValueError, RecursionError) as error:
        raise UnusableError(f"it is no XML: {str(error)[:200]}") from None
