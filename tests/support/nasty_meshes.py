"""Meshes that a user might bring: two hundred, most with something wrong, the same in every run."""

from __future__ import annotations

import os
import struct
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import trimesh
from numpy.typing import NDArray

Mesh = tuple[NDArray[np.float64], NDArray[np.int64]]
Rng = np.random.Generator


def shapes() -> dict[str, Mesh]:
    """Return closed meshes of about 60 mm, in metres."""
    create = trimesh.creation
    rng = np.random.default_rng(7)
    found = {
        "box": create.box((0.03, 0.05, 0.07)),
        "ball": create.icosphere(2, 0.03),
        "rod": create.cylinder(0.01, 0.12, sections=24),
        "ring": create.torus(0.03, 0.01, major_sections=24, minor_sections=12),
        "capsule": create.capsule(0.05, 0.02, count=[8, 16]),
        "cone": create.cone(0.03, 0.06, sections=24),
        "rock": trimesh.PointCloud(rng.normal(0.0, 0.02, (40, 3))).convex_hull,
        "stone": trimesh.PointCloud(rng.uniform(-0.03, 0.03, (20, 3))).convex_hull,
    }
    return {name: (np.array(m.vertices), np.array(m.faces)) for name, m in found.items()}


def _scaled(factor: float) -> Callable[[Mesh, Rng], Mesh]:
    return lambda mesh, rng: (mesh[0] * factor, mesh[1])


def _spoilt(value: float) -> Callable[[Mesh, Rng], Mesh]:
    def change(mesh: Mesh, rng: Rng) -> Mesh:
        vertices = mesh[0].copy()
        vertices[rng.integers(len(vertices)), rng.integers(3)] = value
        return vertices, mesh[1]

    return change


def _inverted(mesh: Mesh, rng: Rng) -> Mesh:
    return mesh[0], mesh[1][:, ::-1]


def _half_inverted(mesh: Mesh, rng: Rng) -> Mesh:
    faces = mesh[1].copy()
    some = rng.random(len(faces)) < 0.5
    faces[some] = faces[some][:, ::-1]
    return mesh[0], faces


def _doubled(mesh: Mesh, rng: Rng) -> Mesh:
    return mesh[0], np.vstack([mesh[1], mesh[1][::2]])


def _two_sided(mesh: Mesh, rng: Rng) -> Mesh:
    return mesh[0], np.vstack([mesh[1], mesh[1][:, ::-1]])


def _soup(mesh: Mesh, rng: Rng) -> Mesh:
    return mesh[0][mesh[1]].reshape(-1, 3), np.arange(mesh[1].size).reshape(-1, 3)


def _one_face_less(mesh: Mesh, rng: Rng) -> Mesh:
    return mesh[0], mesh[1][1:]


def _open(mesh: Mesh, rng: Rng) -> Mesh:
    height = mesh[0][mesh[1]].mean(axis=1)[:, 2]
    return mesh[0], mesh[1][height < np.quantile(height, 0.8)]


def _with_fin(mesh: Mesh, rng: Rng) -> Mesh:
    a, b, _ = mesh[1][0]
    tip = mesh[0].mean(axis=0) * 0.5 + mesh[0][a]
    return np.vstack([mesh[0], tip]), np.vstack([mesh[1], [a, b, len(mesh[0])]])


def _with_slivers(mesh: Mesh, rng: Rng) -> Mesh:
    a = mesh[1][:5, 0]
    return mesh[0], np.vstack([mesh[1], np.stack([a, a, mesh[1][:5, 1]], axis=1)])


def _with_strays(mesh: Mesh, rng: Rng) -> Mesh:
    return np.vstack([mesh[0], [[9.0, 9.0, 9.0], [np.nan] * 3]]), mesh[1]


def _pair(apart: float) -> Callable[[Mesh, Rng], Mesh]:
    def change(mesh: Mesh, rng: Rng) -> Mesh:
        other = mesh[0] + [apart, 0.0, 0.0]
        return np.vstack([mesh[0], other]), np.vstack([mesh[1], mesh[1] + len(mesh[0])])

    return change


def _hollow(mesh: Mesh, rng: Rng) -> Mesh:
    center = mesh[0].mean(axis=0)
    inner = (mesh[0] - center) * 0.5 + center
    return np.vstack([mesh[0], inner]), np.vstack([mesh[1], mesh[1][:, ::-1] + len(mesh[0])])


def _flat(mesh: Mesh, rng: Rng) -> Mesh:
    return mesh[0] * [1.0, 1.0, 0.0], mesh[1]


def _thin(mesh: Mesh, rng: Rng) -> Mesh:
    return mesh[0] * [1.0, 1.0, 0.02], mesh[1]


def _mirrored(mesh: Mesh, rng: Rng) -> Mesh:
    return mesh[0] * [-1.0, 1.0, 1.0], mesh[1]


def _shifted(mesh: Mesh, rng: Rng) -> Mesh:
    return mesh[0] + [0.3, -0.2, 0.4], mesh[1]


def _far(mesh: Mesh, rng: Rng) -> Mesh:
    return mesh[0] + [1e5, 0.0, 0.0], mesh[1]


def _rough(mesh: Mesh, rng: Rng) -> Mesh:
    return mesh[0] * rng.uniform(0.97, 1.03, (len(mesh[0]), 1)), mesh[1]


def _crumpled(mesh: Mesh, rng: Rng) -> Mesh:
    return mesh[0] + rng.normal(0.0, 0.008, mesh[0].shape), mesh[1]


def _wild_index(mesh: Mesh, rng: Rng) -> Mesh:
    faces = mesh[1].copy()
    faces[rng.integers(len(faces)), 1] = 2_000_000_000
    return mesh[0], faces


CHANGES: dict[str, Callable[[Mesh, Rng], Mesh]] = {
    "plain": lambda mesh, rng: mesh,
    "mm": _scaled(1e3),
    "cm": _scaled(1e2),
    "inch": _scaled(39.37),
    "tiny": _scaled(1e-2),
    "minute": _scaled(1e-9),
    "huge": _scaled(1e6),
    "large": _scaled(8.0),
    "nan": _spoilt(np.nan),
    "inf": _spoilt(np.inf),
    "astronomic": _spoilt(1e300),
    "inverted": _inverted,
    "half_inverted": _half_inverted,
    "doubled": _doubled,
    "two_sided": _two_sided,
    "soup": _soup,
    "one_face_less": _one_face_less,
    "open": _open,
    "fin": _with_fin,
    "slivers": _with_slivers,
    "strays": _with_strays,
    "pair": _pair(0.08),
    "overlap": _pair(0.01),
    "hollow": _hollow,
    "flat": _flat,
    "thin": _thin,
    "mirrored": _mirrored,
    "shifted": _shifted,
    "far": _far,
    "rough": _rough,
    "crumpled": _crumpled,
    "wild_index": _wild_index,
}
DEAR = {"open", "crumpled"}
"""Their decomposition takes many seconds: there are fewer of them."""
WRITTEN_ONLY_WITH_INDICES = {"wild_index", "strays"}
"""An STL file has no indices."""


def write_meshes(folder: Path, *, every: int) -> int:
    """Write each change of every n-th shape, and return how many files that are."""
    rng = np.random.default_rng(11)
    written = 0
    for i, (change, function) in enumerate(CHANGES.items()):
        for j, (name, mesh) in enumerate(shapes().items()):
            if (i + j) % (every * 3 if change in DEAR else every):
                continue
            kinds = ("obj", "ply") if change in WRITTEN_ONLY_WITH_INDICES else ("obj", "stl", "ply")
            kind = kinds[(i // 3 + j) % len(kinds)]
            path = folder / change / f"{name}.{kind}"
            path.parent.mkdir(exist_ok=True, parents=True)
            path.write_bytes(encode(kind, *function(mesh, rng)))
            written += 1
    return written


def encode(kind: str, vertices: NDArray[np.float64], faces: NDArray[np.int64]) -> bytes:
    """Return a mesh as a file's content."""
    if kind == "stl":
        rows = np.zeros(len(faces), [("n", "<f4", 3), ("v", "<f4", (3, 3)), ("a", "<u2")])
        with np.errstate(over="ignore"):
            rows["v"] = vertices[faces]
        return b"\0" * 80 + struct.pack("<I", len(faces)) + rows.tobytes()
    if kind == "ply":
        head = (
            f"ply\nformat ascii 1.0\nelement vertex {len(vertices)}\nproperty double x\n"
            f"property double y\nproperty double z\nelement face {len(faces)}\n"
            "property list uchar int vertex_indices\nend_header\n"
        )
        rows_of_text = [f"{x!r} {y!r} {z!r}" for x, y, z in vertices.tolist()]
        rows_of_text += [f"3 {a} {b} {c}" for a, b, c in faces.tolist()]
        return (head + "\n".join(rows_of_text) + "\n").encode()
    lines = [f"v {x!r} {y!r} {z!r}" for x, y, z in vertices.tolist()]
    lines += [f"f {a + 1} {b + 1} {c + 1}" for a, b, c in faces.tolist()]
    return ("\n".join(lines) + "\n").encode()


def write_oddities(folder: Path) -> dict[str, bool]:
    """Write files that are odd in themselves; return for each whether it can be used."""
    box = shapes()["box"]
    good, stl = encode("obj", *box), encode("stl", *box)
    files: dict[str, tuple[bytes, bool]] = {
        "Größe 7 🙂.obj": (good, True),
        "with space.STL": (stl, True),
        "two\nlines.obj": (good, False),
        "bell\x07.obj": (good, False),
        "turned\u202eback.obj": (good, False),
        "same.obj": (good, True),
        "same.stl": (stl, True),
        "empty.obj": (b"", False),
        "empty.stl": (b"", False),
        "empty.ply": (b"", False),
        "empty.urdf": (b"", False),
        "zeros.stl": (b"\0" * 84, False),
        "text.stl": (b"hello, I am no mesh", False),
        "text.ply": (b"hello, I am no mesh", False),
        "text.obj": (b"hello, I am no mesh", False),
        "noise.stl": (np.random.default_rng(1).bytes(5000), False),
        "noise.ply": (np.random.default_rng(2).bytes(5000), False),
        "noise.obj": (np.random.default_rng(3).bytes(5000), False),
        "noise.urdf": (np.random.default_rng(4).bytes(5000), False),
        "cut.stl": (stl[:300], False),
        "boast.stl": (stl[:80] + b"\xff\xff\xff\xff" + stl[84:], False),
        "boast.ply": (encode("ply", *box).replace(b"vertex 8", b"vertex 4000000000"), False),
        "triangle.obj": (b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n", False),
        "points.obj": (b"v 0 0 0\nv 1 0 0\nv 0 1 0\n", False),
        "zero_index.obj": (good.replace(b"f 1", b"f 0", 1) + b"f 0 1 2\n", False),
        "words.obj": (good + b"v one two three\n", False),
        "short.obj": (good + b"v 1 2\n", False),
        "big_index.obj": (good + b"f 1 2 99999999999999999999999\n", False),
        "negative.obj": (_relative(*box), True),
        "quads.obj": (_quads(), True),
        "evil.obj": (b"mtllib ../../../etc/passwd\nusemtl x\n" + good, True),
        "crlf.obj": (good.replace(b"\n", b"\r\n"), True),
        "ascii.stl": (_ascii_stl(*box), True),
        "colored.ply": (_colored(*box), True),
        "point.obj": (b"v 1 1 1\n" * 4 + b"f 1 2 3\nf 1 2 4\nf 1 3 4\nf 2 3 4\n", False),
    }
    for name, (data, _) in files.items():
        (folder / name).write_bytes(data)
    expected = {name: ok for name, (_, ok) in files.items()}
    (folder / "folder.obj").mkdir()
    (folder / "round").symlink_to(folder)
    (folder / "link.obj").symlink_to(folder / "same.obj")
    (folder / "loop.obj").symlink_to(folder / "loop.obj")
    (folder / "away.obj").symlink_to("/etc/passwd")
    os.mkfifo(folder / "pipe.stl")
    odd = ("folder.obj", "link.obj", "loop.obj", "away.obj", "pipe.stl")
    return expected | dict.fromkeys(odd, False)


def many_triangles(count: int) -> bytes:
    """Return a closed mesh, no convex one, of at least so many triangles, as STL."""
    sections = int(np.ceil(np.sqrt(count / 2)))
    ring = trimesh.creation.torus(0.03, 0.012, major_sections=sections, minor_sections=sections)
    return encode("stl", np.array(ring.vertices), np.array(ring.faces))


def _relative(vertices: NDArray[np.float64], faces: NDArray[np.int64]) -> bytes:
    """Return an OBJ whose faces count from the end so far, with vertices after them."""
    lines = [f"v {x!r} {y!r} {z!r}" for x, y, z in vertices.tolist()]
    lines += ["f " + " ".join(str(i - len(vertices)) for i in face) for face in faces.tolist()]
    return ("\n".join([*lines, "v 0.01 0.01 0.01"]) + "\n").encode()


def _quads() -> bytes:
    corners = [(x, y, z) for x in (0, 0.04) for y in (0, 0.05) for z in (0, 0.06)]
    faces = ("1 2 4 3", "5 7 8 6", "1 5 6 2", "3 4 8 7", "1 3 7 5", "2 6 8 4")
    lines = [*(f"v {x} {y} {z}" for x, y, z in corners), *(f"f {face}" for face in faces)]
    return "\n".join(lines).encode()


def _ascii_stl(vertices: NDArray[np.float64], faces: NDArray[np.int64]) -> bytes:
    def lines() -> Iterator[str]:
        yield "solid box"
        for face in faces:
            yield "facet normal 0 0 0\nouter loop"
            for x, y, z in vertices[face].tolist():
                yield f"vertex {x} {y} {z}"
            yield "endloop\nendfacet"
        yield "endsolid box\n"

    return "\n".join(lines()).encode()


def _colored(vertices: NDArray[np.float64], faces: NDArray[np.int64]) -> bytes:
    text = encode("ply", vertices, faces).decode().split("\n")
    at = text.index("property double z") + 1
    text[at:at] = [f"property uchar {name}" for name in ("red", "green", "blue")]
    start = text.index("end_header") + 1
    for i in range(start, start + len(vertices)):
        text[i] += " 255 51 0"
    return "\n".join(text).encode()
