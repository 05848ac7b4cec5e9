"""Parsers of the files of a store: each input is written into a copy of a store, which is read."""

from __future__ import annotations

import atexit
import os
import shutil
import tempfile
import zlib
from collections.abc import Callable
from functools import cache
from pathlib import Path

import google_crc32c
import numpy as np
import pytest
from fuzz.target import Target
from numcodecs.zstd import compress
from support.places import TINY

from grasp_factory.curation.verify import verify
from grasp_factory.dataset.annotations import AnnotationLog
from grasp_factory.dataset.dataset import Dataset
from grasp_factory.writers.zarr import segment_packing
from grasp_factory.writers.zarr.chunks import VLEN
from grasp_factory.writers.zarr.columns import Columns

SPECS = "episodes/spec/0"
SHARD = "cameras/front/rgb/0.0.0.0.0"
INDEX_BYTES = 16 * 8
"""Of a shard's index: offset and length of two images of four episodes."""
SEGMENT = "packed/0-0.npz"
LOG = "annotations/log.jsonl"
SEALED = b', "crc32"'
ARRAYS = ("episodes/spec", "episodes/outcome", "streams/tcp_pose", "cameras/front/rgb")


@cache
def store() -> Path:
    """Return a store that the targets change: of four episodes, packed, with annotations."""
    memory = Path("/dev/shm")
    folder = Path(tempfile.mkdtemp(dir=memory if memory.is_dir() else None))
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    path = Path(shutil.copytree(TINY, folder / "s.zarr"))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(segment_packing, "SEGMENT_BLOCKS", 1)
        segment_packing.pack(path)
    AnnotationLog(path).append("me", [0, 2], [("tag", "odd"), ("note", "it slipped")])
    return path


@cache
def content(name: str) -> bytes:
    """Return the true content of a file of the store."""
    return (store() / name).read_bytes()


def of_file(name: str, read: Callable[[], object]) -> Target:
    """Return a target that writes its input into a file of the store, then reads."""

    def parse(data: bytes) -> None:
        before = content(name)
        (store() / name).write_bytes(data)
        try:
            read()
        finally:
            (store() / name).write_bytes(before)

    return Target(parse, lambda: [content(name)], is_json=name.endswith(".json"))


def made(
    target: Target, change: Callable[[bytes], bytes], examples: Callable[[], list[bytes]]
) -> Target:
    """Return a target whose inputs are changed before another target gets them."""
    return Target(lambda data: target.parse(change(data)), examples, is_json=target.is_json)


def read_rows() -> None:
    """Read all of two episodes."""
    dataset = Dataset(store())
    for row in (0, 3):
        dataset[row]


def read_log() -> object:
    """Read all changes of annotations."""
    return AnnotationLog(store()).changes()


def read_recipe() -> object:
    """Read a recipe."""
    return Dataset(store()).spec(0)


def with_checksum(data: bytes) -> bytes:
    """Return a shard whose index has the right checksum, so that what it says is used."""
    return data + google_crc32c.value(data[-INDEX_BYTES:]).to_bytes(4, "little")


def sealed_lines(data: bytes) -> bytes:
    """Return a line of a log, without its end, and the seal that belongs to it."""
    line = data.replace(b"\n", b"").removesuffix(b"}")
    return b'%b%b: "%08x"}\n' % (line, SEALED, zlib.crc32(line))


def lines() -> list[bytes]:
    """Return the lines of the log as JSON without a seal."""
    return [line.rpartition(SEALED)[0] + b"}" for line in content(LOG).splitlines()]


def recipes(data: bytes) -> bytes:
    """Return a chunk of recipes: the input, four times."""
    words = np.array([data.decode("utf-8", "replace")] * 4, object)
    return bytes(compress(VLEN.encode(words), 1))


def specs() -> list[bytes]:
    """Return a recipe of the store."""
    return [Dataset(store()).spec(0).to_json().encode()]


def parse_name(data: bytes) -> None:
    """Read a store in which a file has this name."""
    folders = ("episodes/status", "packed", "labels", "annotations", "streams/tcp_pose", "")
    folder = store() / folders[data[0] % len(folders) if data else 0]
    name = data[1:].replace(b"/", b"").replace(b"\0", b"")[:200]
    file = os.fsencode(folder) + b"/" + name
    if name in (b"", b".", b"..") or os.path.lexists(file):
        return
    folder.mkdir(exist_ok=True)
    Path(os.fsdecode(file)).touch()
    try:
        Columns.open(store()).read("outcome")
        verify(store())
    finally:
        os.unlink(file)


def json_of(target: Target) -> Target:
    """Return a target most of whose inputs are JSON."""
    return Target(target.parse, target.examples, is_json=True)


TARGETS = {
    "root document": of_file("zarr.json", read_rows),
    **{f"document of {name}": of_file(f"{name}/zarr.json", read_rows) for name in ARRAYS},
    "numbers": of_file("episodes/outcome/0", read_rows),
    "words": of_file(SPECS, read_rows),
    "shard": of_file(SHARD, read_rows),
    "index of a shard": made(
        of_file(SHARD, read_rows), with_checksum, lambda: [content(SHARD)[:-4]]
    ),
    "segment": of_file(SEGMENT, lambda: Columns.open(store()).read("outcome", "spec")),
    "log": of_file(LOG, read_log),
    "line of the log": json_of(made(of_file(LOG, read_log), sealed_lines, lines)),
    "recipe": json_of(made(of_file(SPECS, read_recipe), recipes, specs)),
    "recipe in verify": json_of(made(of_file(SPECS, lambda: verify(store())), recipes, specs)),
    "name": Target(parse_name, lambda: [b"\x000", b"\x011-2.npz", b"\x02strict", b"\x05odd.txt"]),
}
