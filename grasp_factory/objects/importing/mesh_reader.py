"""Read OBJ, STL and PLY from bytes. Runs in the child process: trimesh is imported here."""

from __future__ import annotations

import io
import math
from codecs import BOM_UTF8
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import trimesh
from numpy.typing import NDArray

from grasp_factory.core.geometry import Array, Vector3
from grasp_factory.errors import shown
from grasp_factory.objects.importing.base import UnusableError

MAX_FACES = 2_000_000
MIN_FACES = 4
"""Faces of a tetrahedron."""
STL_HEAD, STL_FACE = 84, 50
"""Bytes."""
NO_MESH = {
    b"\x1f\x8b": "compressed (gzip): unpack it",
    b"pk\x03\x04": "a zip file: unpack it",
    b"<!doctype html": "a web page",
    b"<html": "a web page",
    b"version https://git-lfs": "a pointer of Git LFS: run `git lfs pull`",
}
"""What a file is, by its first bytes in lower case."""


@dataclass(frozen=True, slots=True)
class MeshSurface:
    """The triangles of a file; all numbers are finite and all vertex indices are valid."""

    vertices: Array
    """(n, 3), in the file's unit."""
    faces: NDArray[np.int64]
    """(m, 3)."""
    color: Vector3 | None
    """Mean of the file's own colours, RGB in 0 to 1."""


def read_mesh(kind: str, data: bytes) -> MeshSurface:
    """Return the triangles of a mesh file's content.

    Raises:
        UnusableError: if there are no triangles, or some of them are invalid.
    """
    data = _without_mark(kind, data)
    if not data.strip(b"\0 \t\r\n"):
        raise UnusableError("the file is empty")
    _check_kind(kind, data)
    vertices, faces, color = _read_obj(data) if kind == "obj" else _read_other(kind, data)
    if not len(vertices) or not len(faces):
        raise UnusableError("it has no faces")
    if len(faces) < MIN_FACES:
        raise UnusableError(f"it has {len(faces)} faces, and a solid has {MIN_FACES} or more")
    if len(faces) > MAX_FACES:
        raise UnusableError(f"it has {len(faces)} faces, valid: up to {MAX_FACES}")
    if faces.min() < 0 or faces.max() >= len(vertices):
        raise UnusableError("it has a face with a vertex that is not there")
    used, faces = np.unique(faces, return_inverse=True)
    vertices = vertices[used]
    if not np.isfinite(vertices).all() or np.abs(vertices).max() > 1e12:
        raise UnusableError("it has a vertex that is not a number, or infinite")
    return MeshSurface(vertices, faces.reshape(-1, 3), color)


def _check_kind(kind: str, data: bytes) -> None:
    """Refuse data that is clearly of another kind, before a reader fails on it."""
    for start, what in NO_MESH.items():
        if data[:64].lstrip().lower().startswith(start):
            raise UnusableError(f"it is no {kind.upper()} file, but {what}")
    if kind == "stl" and len(data) >= STL_HEAD and b"facet" not in data[: 2**16].lower():
        count = int.from_bytes(data[STL_HEAD - 4 : STL_HEAD], "little")
        expected = STL_HEAD + STL_FACE * count
        if len(data) != expected:
            raise UnusableError(
                f"it is cut off or damaged: a binary STL file of {count} faces has {expected}"
                f" bytes, and it has {len(data)}"
            )


def _without_mark(kind: str, data: bytes) -> bytes:
    """Return text without its byte order mark, and binary files unchanged."""
    marked = data.startswith(BOM_UTF8)
    is_text = kind != "stl" or b"facet" in data[: 2**16].lower()
    return data[len(BOM_UTF8) :] if marked and is_text else data


def _read_other(kind: str, data: bytes) -> tuple[Array, NDArray[np.int64], Vector3 | None]:
    try:
        mesh = trimesh.load_mesh(io.BytesIO(data), file_type=kind, process=False)
    except MemoryError:
        raise
    except Exception as error:  # the readers raise many types for broken files
        why = f"{type(error).__name__}: {(str(error).splitlines() or [''])[0]}"
        raise UnusableError(f"it is no {kind.upper()} file that can be read: {why[:200]}") from None
    if not isinstance(mesh, trimesh.Trimesh):
        raise UnusableError("it has no faces")
    color = None
    if mesh.visual.kind in ("vertex", "face"):
        colors = mesh.visual.vertex_colors if mesh.visual.kind == "vertex" else None
        colors = mesh.visual.face_colors if colors is None else colors
        color = _mean(np.asarray(colors, np.float64)[:, :3] / 255.0)
    return np.asarray(mesh.vertices, np.float64), np.asarray(mesh.faces, np.int64), color


def _read_obj(data: bytes) -> tuple[Array, NDArray[np.int64], Vector3 | None]:
    """Read positions, colours and faces; ignore all else, especially material files.

    Not trimesh's reader: that takes index 0 as 1, and counts negative ones from the file's end.
    """
    vertices: list[list[float]] = []
    colors: list[list[float]] = []
    faces: list[tuple[int, int, int]] = []
    text = data.decode("utf-8", "replace").replace("\\\r\n", " ").replace("\\\n", " ")
    for number, line in enumerate(io.StringIO(text, newline=None), 1):
        words = line.partition("#")[0].split()
        try:
            if words[:1] == ["v"]:
                values = [float(word) for word in words[1:]]
                vertices.append(values[:3])
                if len(values) < 3:
                    raise ValueError
                if len(values) >= 6:
                    colors.append(values[3:6])
            elif words[:1] == ["f"]:
                first, *others = (_index(word, len(vertices)) for word in words[1:])
                faces += [(first, a, b) for a, b in pairwise(others)]
                if len(faces) > MAX_FACES:
                    raise UnusableError(f"it has more than {MAX_FACES} faces")
        except (ValueError, IndexError):
            raise UnusableError(
                f"it is no OBJ file that can be read: line {number} is {shown(line.strip()[:60])}"
            ) from None
    array = np.array(faces, np.int64) if faces else np.zeros((0, 3), np.int64)
    color = _mean(np.array(colors)) if colors and len(colors) == len(vertices) else None
    return np.array(vertices, np.float64).reshape(-1, 3), array, color


def _index(word: str, vertices: int) -> int:
    """Return the vertex index of a face's corner, counted from 0."""
    index = int(word.partition("/")[0])
    if index == 0 or abs(index) > 2**40:
        raise ValueError
    return index - 1 if index > 0 else vertices + index


def _mean(colors: Array) -> Vector3 | None:
    red, green, blue = (round(float(c), 3) for c in colors.mean(axis=0))
    ok = all(math.isfinite(c) and 0.0 <= c <= 1.0 for c in (red, green, blue))
    return (red, green, blue) if ok else None
