"""Files, arrays and chunks that are large, or claim to be."""

from __future__ import annotations

import gzip
import json
import struct
from collections.abc import Callable
from pathlib import Path
from typing import Any

from numcodecs.zstd import compress
from support.hostile.table import ATTACKS, BYTES, GB, Attack, coded, edited


def sparse(name: str, size: int) -> Attack:
    """Replace a file with one of zeros that takes no space on the disk."""

    def replace(store: Path, outside: Path) -> None:
        (store / name).parent.mkdir(exist_ok=True)
        with (store / name).open("wb") as file:
            file.truncate(size)

    return replace


ATTACKS["a zarr.json of 6 GB"] = sparse("zarr.json", 6 * GB)
ATTACKS["an array's zarr.json of 6 GB"] = sparse("episodes/spec/zarr.json", 6 * GB)
ATTACKS["a chunk of 20 GB"] = sparse("episodes/spec/0", 20 * GB)
ATTACKS["an image chunk of 20 GB"] = sparse("cameras/front/rgb/0.0.0.0.0", 20 * GB)
ATTACKS["a log of 8 GB"] = sparse("annotations/log.jsonl", 8 * GB)
ATTACKS["a packed segment of 20 GB"] = sparse("packed/0-1.npz", 20 * GB)


def _all_rows(rows: Any) -> Attack:
    def edit(store: Path, outside: Path) -> None:
        for file in store.rglob("zarr.json"):
            document = json.loads(file.read_text())
            if document.get("shape") and document["shape"] != [0]:
                document["shape"][0] = rows
                file.write_text(json.dumps(document))

    return edit


for _rows in (2_000_000_000, 2**63, -1, 1e300, "many", None, True, [1], 999_999):
    ATTACKS[f"all arrays have {_rows!r} rows"] = _all_rows(_rows)


def _shape(name: str, shape: list[Any], chunk: list[Any] | None = None) -> Attack:
    def change(document: dict[str, Any]) -> None:
        document["shape"][1:] = shape
        document["chunk_grid"]["configuration"]["chunk_shape"][1:] = chunk or shape

    return edited(name, change)


ATTACKS["images of 60000 x 60000"] = _shape("cameras/front/rgb", [2, 60000, 60000, 3])
ATTACKS["a stream of 2e9 samples"] = _shape("streams/tcp_pose", [2_000_000_000, 7])
ATTACKS["chunks of no size"] = _shape("cameras/front/rgb", [2, 24, 32, 3], [0, 0, 0, 0])
ATTACKS["a column in chunks of no row"] = edited(
    "episodes/spec", lambda d: d["chunk_grid"]["configuration"].update(chunk_shape=[0])
)
ATTACKS["chunks of negative size"] = _shape("cameras/front/rgb", [2, 24, 32, 3], [-1, -1, -1, -1])


_ZSTD = {"name": "zstd", "configuration": {"level": 3, "checksum": False}}
_GZIP = {"name": "gzip", "configuration": {"level": 5}}


def bomb(codec: dict[str, Any], packed: Callable[[int], bytes], size: int) -> Attack:
    """Replace a chunk with a small one that expands to ``size`` bytes of zeros."""

    def explode(store: Path, outside: Path) -> None:
        coded("streams/tcp_pose", [BYTES, codec])(store, outside)
        (store / "streams/tcp_pose/0.0.0").write_bytes(packed(size))
        coded("episodes/checksum", [{"name": "vlen-utf8"}, codec])(store, outside)
        (store / "episodes/checksum/0").write_bytes(packed(size))

    return explode


def zeros_of_zstd(size: int) -> bytes:
    """Return zstd frames, without their sizes, that expand to zeros."""
    part = compress(bytes(2**26), 1)
    return part * (size // 2**26)


def zeros_of_gzip(size: int) -> bytes:
    """Return a gzip file that expands to zeros."""
    part = gzip.compress(bytes(2**26), 9)
    return part * (size // 2**26)


ATTACKS["a zstd chunk that expands to 6 GB"] = bomb(_ZSTD, zeros_of_zstd, 6 * GB)
ATTACKS["a gzip chunk that expands to 5 GB"] = bomb(_GZIP, zeros_of_gzip, 5 * GB)


def _frame(size: int) -> bytes:
    """Return a zstd frame that claims to expand to ``size`` bytes."""
    return b"\x28\xb5\x2f\xfd\xe0" + struct.pack("<Q", size) + b"\x01\x00\x00"


ATTACKS["a zstd chunk that claims 2^60 bytes"] = bomb(_ZSTD, lambda size: _frame(2**60), 0)
