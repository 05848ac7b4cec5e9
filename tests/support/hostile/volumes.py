"""Much data in little space: rows, chunks and words that are many only when they are read."""

from __future__ import annotations

import json
import struct
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from numcodecs.zstd import compress
from support.hostile.sizes import sparse
from support.hostile.table import ATTACKS, BYTES, GB, Attack, attack, coded, configured, edited

_ZSTD = {"name": "zstd", "configuration": {"level": 1, "checksum": False}}
_WORDS = {"name": "vlen-utf8"}


def _grown(store: Path, rows: int) -> None:
    """Give all arrays of the store's rows a number of rows."""
    for file in store.rglob("zarr.json"):
        document = json.loads(file.read_text())
        is_label = "labels" in file.parts
        if document.get("shape") and document["shape"] != [0] and not is_label:
            document["shape"][0] = rows
            file.write_text(json.dumps(document))


def _filled(store: Path, name: str, blocks: range, content: bytes) -> None:
    """Write the same file for each of some blocks."""
    for block in blocks:
        (store / name / str(block)).write_bytes(content)


def _words(word: str, count: int) -> bytes:
    """Return the content of a chunk of equal words."""
    text = word.encode()
    return struct.pack("<I", count) + (struct.pack("<I", len(text)) + text) * count


def _chunked(name: str, chunk: list[int], tail: list[int] | None = None) -> Attack:
    """Change the chunks of an array, and its lengths."""

    def change(document: dict[str, Any]) -> None:
        document["shape"][1:] = document["shape"][1:] if tail is None else tail
        document["chunk_grid"]["configuration"]["chunk_shape"] = chunk

    return edited(name, change)


def _both(*attacks: Attack) -> Attack:
    def act(store: Path, outside: Path) -> None:
        for each in attacks:
            each(store, outside)

    return act


def _long_words(blocks: int, length: int) -> Attack:
    """Give the rows of some blocks long words in each column of names."""

    def change(store: Path, outside: Path) -> None:
        _grown(store, max(2000, 4 * blocks))
        _filled(store, "episodes/status", range(blocks), compress(bytes([1] * 4), 1))
        content = compress(_words("x" * length, 4), 1)
        names = ("policy", "object_set", "split", "object_family", "object_id", "fingerprint")
        for name in (*names, "grasp_proposer"):
            _filled(store, f"episodes/{name}", range(blocks), content)

    return change


ATTACKS["20 blocks of words of 1 MB"] = _long_words(20, 2**20 - 100)
ATTACKS["300 blocks of words of 1 MB"] = _long_words(300, 2**20 - 100)
ATTACKS["300 blocks of words of 64 kB"] = _long_words(300, 2**16)


def _fill(size: int) -> Attack:
    def change(store: Path, outside: Path) -> None:
        _grown(store, 900_000)
        for name in ("policy", "split"):
            fill = edited(f"episodes/{name}", lambda d: d.update(fill_value="x" * size))
            fill(store, outside)

    return change


ATTACKS["900000 rows of a fill value of 100 kB"] = _fill(100_000)
ATTACKS["900000 rows of a fill value of 5 kB"] = _fill(5000)


@attack("a chunk of 11 million words")
def _(store: Path, outside: Path) -> None:
    _chunked("episodes/object_ids", [4, 2_750_000])(store, outside)
    (store / "episodes/object_ids/0.0").write_bytes(compress(_words("ab", 11_000_000), 1))


def _empty_words(count: int) -> Attack:
    """Write a chunk of empty words, of which the disk has a few bytes."""

    def write(store: Path, outside: Path) -> None:
        coded("episodes/policy", [_WORDS])(store, outside)
        with (store / "episodes/policy/0").open("wb") as file:
            file.write(struct.pack("<I", count))
            file.truncate(4 + 4 * count)

    return write


ATTACKS["a chunk of 25 million empty words that is not on the disk"] = _empty_words(25_000_000)
ATTACKS["words of 240 MB that are not on the disk"] = _empty_words(60_000_000)


@attack("80 rows that are damaged")
def _(store: Path, outside: Path) -> None:
    _grown(store, 80)
    _filled(store, "episodes/status", range(20), compress(bytes([1] * 4), 1))


@attack("words of 60 MB in each column of text of a block")
def _(store: Path, outside: Path) -> None:
    configured(block_size=1024)(store, outside)
    content = compress(_words("x" * 60_000, 1024), 1)
    for file in store.glob("episodes/*/zarr.json"):
        document, name = json.loads(file.read_text()), file.parent.name
        tail = document["shape"][1:]
        _chunked(f"episodes/{name}", [1024, *tail])(store, outside)
        if document["data_type"] == "string":
            (file.parent / ("0" + ".0" * len(tail))).write_bytes(content)
    (store / "episodes/status/0").write_bytes(compress(bytes([1] * 1024), 1))


def _one_row_a_block(chunk_rows: int, blocks: int) -> Attack:
    """Return a store whose columns are one chunk each, and whose blocks are one row each."""

    def change(store: Path, outside: Path) -> None:
        _grown(store, 2000)  # more rows are missing than `repair` simulates
        configured(block_size=1)(store, outside)
        for file in store.glob("episodes/*/zarr.json"):
            document = json.loads(file.read_text())
            tail, name = document["shape"][1:], file.parent.name
            _chunked(f"episodes/{name}", [chunk_rows, *tail])(store, outside)
            for old in file.parent.glob("[0-9]*"):
                old.unlink()
            count = chunk_rows * int(np.prod(tail, dtype=int))
            if document["data_type"] == "string":
                content = _words("x", count)
            else:
                content = np.ones(count, document["data_type"]).tobytes()
            _filled(store, f"episodes/{name}", range(1), b"")
            first = file.parent / ("0" + ".0" * len(tail))
            first.write_bytes(compress(content, 1))
        _filled(store, "episodes/status", range(1, blocks), b"")

    return change


ATTACKS["400 blocks of one row in chunks of 9000 rows"] = _one_row_a_block(9000, 400)
ATTACKS["2000 blocks of one row in chunks of 100000 rows"] = _one_row_a_block(100_000, 2000)


@attack("300 million rows in chunks of 160 million")
def _(store: Path, outside: Path) -> None:
    _grown(store, 300_000_000)
    _chunked("episodes/status", [125_000_000])(store, outside)


_IMAGES = "cameras/front/rgb"


def _unsharded(tail: list[int], chunk: list[int]) -> Attack:
    return _both(_chunked(_IMAGES, chunk, tail), coded(_IMAGES, [BYTES, _ZSTD]))


def _sharded(file: list[int], chunk: list[int]) -> Callable[[dict[str, Any]], None]:
    def change(document: dict[str, Any]) -> None:
        document["chunk_grid"]["configuration"]["chunk_shape"] = file
        document["codecs"][0]["configuration"]["chunk_shape"] = chunk

    return change


ATTACKS["rows of 96 MB in blocks of 1024"] = _both(
    configured(block_size=1024), _unsharded([2, 4000, 4000, 3], [1, 1, 4000, 4000, 3])
)
ATTACKS["images of 20000 x 20000 in chunks of 1000"] = _unsharded(
    [2, 20000, 20000, 3], [1, 1, 1000, 1000, 3]
)
ATTACKS["images in chunks of a pixel"] = _unsharded([2, 2000, 2000, 3], [1, 1, 1, 1, 3])
ATTACKS["images of 1200 chunks"] = _unsharded([2, 20, 30, 3], [1, 1, 1, 1, 3])
ATTACKS["a shard of 16 million chunks"] = _both(
    edited(_IMAGES, _sharded([4, 2, 1000, 2000, 1], [1, 1, 1, 1, 1])),
    sparse(f"{_IMAGES}/0.0.0.0.0", 256 * 2**20),
)


@attack("a label of 5 billion rows")
def _(store: Path, outside: Path) -> None:
    for name in ("outcome", "success"):

        def change(document: dict[str, Any]) -> None:
            document["shape"] = [5_000_000_000]
            document["chunk_grid"]["configuration"]["chunk_shape"] = [250_000_000]

        edited(f"labels/gentle/{name}", change)(store, outside)


@attack("40 files of 3 GB that are not on the disk")
def _(store: Path, outside: Path) -> None:
    for number in range(40):
        sparse(f"objects/{number}", 3 * GB)(store, outside)


def _far_block(number: int) -> Attack:
    """Copy block 0 of every array but videos to a block far away."""

    def change(store: Path, outside: Path) -> None:
        for file in store.glob("*/**/zarr.json"):
            for first in file.parent.glob("0*"):
                if first.is_file():
                    name = f"{number}{first.name[1:]}"
                    first.with_name(name).write_bytes(first.read_bytes())

    return change


for _number in (200_000, 99_999_999, 999_999_999_999):
    ATTACKS[f"a block {_number} of all arrays"] = _far_block(_number)


def _shaped(shape: Any) -> Attack:
    """Change a shape in a store of another version, whose arrays may differ from those of ours."""
    older = edited("", lambda d: d["attributes"]["versions"].update(grasp_factory="0.7.0"))
    return _both(older, edited("streams/tcp_pose", lambda document: document.update(shape=shape)))


for _shape in (7, {}, None, "rows", [None], [[3]], [-1, 7]):
    ATTACKS[f"a shape that is {_shape}"] = _shaped(_shape)


@attack("sources that do not name the seed of the rows")
def _(store: Path, outside: Path) -> None:
    source = {"seed": 999, "rows": 10, "config_sha256": "0" * 64, "made_with": []}
    edited("", lambda d: d["attributes"].update(sources=[source]))(store, outside)


for _sources in (7, [7], [{"seed": [1]}], {"seed": 3}):
    ATTACKS[f"sources that are {_sources}"] = edited(
        "", lambda d, found=_sources: d["attributes"].update(sources=found)
    )
