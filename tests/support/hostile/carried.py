"""Objects and models that a store contains, so that its recipes can be simulated elsewhere."""

from __future__ import annotations

import json
import struct
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import zarr
from support.hostile.recipes import Recipe
from support.hostile.table import ATTACKS, DEEP, ESCAPE, GB, Attack, attack, configured, edited
from support.tiny_archive import COLLISION, archive, manifest

from grasp_factory.core.cache import digest
from grasp_factory.writers.zarr.embedded import add_embedded


def _embed(store: Path, path: str, content: bytes, **config: Any) -> None:
    """Embed data in a store whose config names them."""
    root = zarr.open_group(store, mode="r+", use_consolidated=False)
    root.create_group(path.partition("/")[0])
    add_embedded(root, path, content)
    configured(**config)(store, store)


def objects(make: Callable[[], bytes], sha256: str = "") -> Attack:
    """Contain an archive of objects, one of which is the target of a recipe."""

    def contain(store: Path, outside: Path) -> None:
        named = sha256 or digest(manifest())
        target = {"object_set": "mine", "folder_sha256": named, "object_id": "mine/a"}
        Recipe(lambda plain: plain["objects"][0].update(target))(store, outside)
        sets = {"object_sets": {"mine": 1.0}, "object_folders": {"mine": named}}
        _embed(store, "objects/mine", make(), **sets)

    return contain


def mesh(make: Callable[[], bytes]) -> Attack:
    """Contain an object with a mesh."""

    def contain(store: Path, outside: Path) -> None:
        collision = make()
        named = digest(manifest(collision))
        objects(lambda: archive(collision), named)(store, outside)

    return contain


def model(content: bytes) -> Attack:
    """Contain a trained model that a recipe uses."""

    def contain(store: Path, outside: Path) -> None:
        settings = {"model": digest(content)}

        def use(plain: dict[str, Any]) -> None:
            plain.update(policy="learned", policy_parameters=settings)

        Recipe(use)(store, outside)
        config = {"policies": {"learned": 1.0}, "policy_parameters": {"learned": settings}}
        _embed(store, "models/learned", content, **config)

    return contain


def code(content: bytes, file: str = "evil.py", sha256: str = "") -> Attack:
    """Contain a source file, whose policy a recipe and the config use."""
    named = sha256 or digest(content)

    def contain(store: Path, outside: Path) -> None:
        Recipe(lambda plain: plain.update(policy="evil_plan", policy_parameters={}))(store, outside)
        origin = {"sha256": named, "attribute": "plan", "file": file}
        config = {
            "policies": {"evil_plan": 1.0},
            "plugins": {"policies": {"evil_plan": origin}},
        }
        _embed(store, f"plugins/{named}", content, **config)

    return contain


def package(module: str, attribute: str, sha256: str) -> Attack:
    """Name an object of a module that is installed, but offers no plugin."""
    origin = {"sha256": sha256, "attribute": attribute, "module": module, "distribution": "os"}
    config = {"policies": {"evil": 1.0}, "plugins": {"policies": {"evil": origin}}}
    return configured(**config)


def _group(i: int) -> bytes:
    corners = b"\n".join(b"v 0.0%d 0.0%d 0.0%d" % (i % 7, i % 5, j) for j in range(1, 5))
    a, b, c, d = range(4 * i + 1, 4 * i + 5)
    return b"o part_%d\n%s\nf %d %d %d\nf %d %d %d\n" % (i, corners, a, b, c, b, c, d)


def _groups(count: int) -> bytes:
    return b"".join(map(_group, range(count)))


def _cloud(count: int) -> bytes:
    """Return one group of many random corners."""
    points = np.random.default_rng(0).uniform(0.001, 0.05, (count, 3)).tolist()
    corners = b"".join(b"v %.7f %.7f %.7f\n" % tuple(point) for point in points)
    faces = b"".join(b"f %d %d %d\n" % (i, i + 1, i + 2) for i in range(1, count - 1))
    return b"o part_0\n" + corners + faces


def _manifest(count: int) -> bytes:
    return json.dumps({"format": 1, "objects": {str(i): 0 for i in range(count)}}).encode()


ATTACKS |= {
    "a carried mesh of 3,000 groups": mesh(lambda: _groups(3000)),
    "a carried mesh of 64 groups in one plane": mesh(lambda: _groups(64)),
    "a carried mesh of 100,000 corners": mesh(lambda: _cloud(100_000)),
    "a carried mesh that is a point": mesh(lambda: b"o part_0\nv 0 0 0\nf 1 1 1\n"),
    "a carried mesh with a face of nothing": mesh(lambda: COLLISION + b"f 0 999999999 7\n"),
    "a carried mesh that names a file": mesh(lambda: b"mtllib ../../home/bashrc\n" + COLLISION),
    "a carried mesh with numbers without end": mesh(lambda: b"v 1e999 0 0\n" + COLLISION),
    "a carried archive that is noise": objects(lambda: bytes(range(256)) * 1000),
    "a carried archive of another name": objects(archive, "0" * 64),
    "a carried archive with a path as its name": objects(archive, "../../../home/docs"),
    "a carried manifest that is nested deep": objects(lambda: archive(told=DEEP.encode())),
    "a carried manifest of a million objects": objects(lambda: archive(told=_manifest(10**6))),
    "a carried model that is noise": model(bytes(range(256)) * 1000),
    "a carried model that is a pickle": model(b"\x80\x04cos\nsystem\n(S'touch pickled'\ntR."),
    "a carried model with a header of 2^60 bytes": model(struct.pack("<Q", 2**60) + b"{}"),
    "carried code that does harm": code(b"open('../home/bashrc', 'w').write('owned')\n"),
    "carried code with escapes": code(ESCAPE.encode() + b"\n", file="\x1b]0;owned\x07.py"),
    "carried code of another hash": code(b"plan = 1\n", sha256="0" * 64),
    "carried code that is no text": code(bytes(range(256)) * 4),
    "carried code of a megabyte": code(b"#" * 2**20),
    "carried code with a path as its name": code(b"plan = 1\n", file="../../home/bashrc.py"),
    "code of the module os": package("os", "system", "0" * 64),
    "code with a path as its hash": package("os", "system", "../../../home/docs"),
    "a carried model with a deep header": model(struct.pack("<Q", len(DEEP)) + DEEP.encode()),
}  # fmt: skip


@attack("carried objects of 4 GB")
def _(store: Path, outside: Path) -> None:
    objects(archive)(store, outside)
    edited("objects/mine", lambda document: document.update(shape=[4 * GB]))(store, outside)


@attack("carried objects of 4 GB in one chunk")
def _(store: Path, outside: Path) -> None:
    objects(archive)(store, outside)

    def enlarge(document: dict[str, Any]) -> None:
        document.update(shape=[4 * GB])
        document["chunk_grid"]["configuration"]["chunk_shape"] = [4 * GB]

    edited("objects/mine", enlarge)(store, outside)
