"""Map the schema to Zarr arrays: shapes, chunks, shards, codec and attributes."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from typing import Any

import numpy as np

from grasp_factory.core import schema
from grasp_factory.core.config.factory_config import FactoryConfig
from grasp_factory.core.place import Place
from grasp_factory.writers.zarr.metadata_checksum import write_sealed

# Plain zstd for everything; docs/performance/scale.md compares other codecs. Level 3 makes an
# episode 1 % smaller and takes 50 % longer. Byte-shuffle would save 10 of the 57 KiB of streams;
# with images an episode has about 330 KiB, so that is not worth a second codec.
ZSTD_LEVEL = 1

# Chunk files are named 3.0.0 instead of c/3/0/0: no directory per shard, one fsync makes all
# names of an array durable, and the block's number leads every file name.
KEYS = {"name": "v2", "separator": "."}

MOST_DIGITS = 12
"""Longest number of a block or an episode in the name of a file."""
_LITTLE: dict[str, Any] = {"name": "bytes", "configuration": {"endian": "little"}}
_ZSTD: dict[str, Any] = {"name": "zstd", "configuration": {"level": ZSTD_LEVEL, "checksum": False}}


def shapes(
    fields: Collection[schema.Field], config: FactoryConfig, joints: int, n: int
) -> dict[schema.Field, tuple[int, ...]]:
    """Return the shape of each field's array for ``n`` episodes; ``joints`` are the robot's."""
    sizes = {**schema.sizes(config, joints), "A": len(schema.digested(fields))}
    return {row: (n, *schema.shape(row, sizes)) for row in fields}


def create_array(folder: Place, path: str, metadata: Mapping[str, Any]) -> None:
    """Create an array, empty, and the groups above it, in a store's folder.

    Args:
        folder: the store's folder.
        path: the path of the array in the store.
        metadata: its ``zarr.json``, without a seal.

    Raises:
        OSError: if the disk fails.
    """
    *groups, _ = path.split("/")
    for depth in range(len(groups)):
        group = folder / "/".join(groups[: depth + 1])
        if not group.exists():
            group.mkdir()
            write_sealed(group / "zarr.json", _node("group", {}))
    (folder / path).mkdir()
    write_sealed(folder / path / "zarr.json", metadata)


def documents(
    fields: Collection[schema.Field], config: FactoryConfig, joints: int, n: int
) -> dict[str, dict[str, Any]]:
    """Return by path the ``zarr.json``, without a seal, of each field's array for ``n`` episodes.

    They are written here and not by the Zarr library, so that they are the same for all its
    versions. The keys are those of an array's metadata in the Zarr core specification, version 3.
    """
    recorded = schema.digested(fields)
    return {
        row.path: _document(row, whole, config.block_size, attributes(row, recorded))
        for row, whole in shapes(fields, config, joints, n).items()
    }


def _document(
    row: schema.Field, whole: tuple[int, ...], block_size: int, attributes: dict[str, Any]
) -> dict[str, Any]:
    block = [block_size, *whole[1:]]
    codecs = [_values(row.dtype), _ZSTD]
    if row.is_image:
        # A block of videos, padded to the longest attempt, would be too large to hold.
        file = [1, *whole[1:]] if row.is_video else block
        codecs = [_shard([1, 1, *whole[2:]], codecs)]
    elif row.length_column:
        file, codecs = block, [_shard([1, *whole[1:]], codecs)]
    else:
        file = block
    is_nan = isinstance(row.fill, float) and math.isnan(row.fill)
    return {
        "shape": list(whole),
        "data_type": row.dtype,
        "chunk_grid": {"name": "regular", "configuration": {"chunk_shape": file}},
        "chunk_key_encoding": {
            "name": KEYS["name"],
            "configuration": {"separator": KEYS["separator"]},
        },
        "fill_value": "NaN" if is_nan else row.fill,
        "codecs": codecs,
        **_node("array", attributes, dimension_names=dimension_names(row)),
        "storage_transformers": [],
    }


def _values(dtype: str) -> dict[str, Any]:
    """Return the codec that makes bytes of values."""
    if dtype == "string":
        return {"name": "vlen-utf8", "configuration": {}}
    return {"name": "bytes"} if np.dtype(dtype).itemsize == 1 else _LITTLE


def _shard(chunk: list[int], codecs: list[Any]) -> dict[str, Any]:
    """Return the codec of a file of many chunks, whose index is at its end."""
    return {
        "name": "sharding_indexed",
        "configuration": {
            "chunk_shape": chunk,
            "codecs": codecs,
            "index_codecs": [_LITTLE, {"name": "crc32c"}],
            "index_location": "end",
        },
    }


def _node(kind: str, attributes: dict[str, Any], **more: Any) -> dict[str, Any]:
    return {"attributes": attributes, **more, "zarr_format": 3, "node_type": kind}


def dimension_names(row: schema.Field) -> list[str]:
    """Return a name for each dimension of a field's array; equal letters have equal names."""
    leaf, shared = row.path.rsplit("/", 1)[-1], schema.dimension_names()
    own = [
        shared[dim] if isinstance(dim, str) else f"{leaf}_{axis}"
        for axis, dim in enumerate(row.dims, start=1)
    ]
    return ["episode", *own]


def attributes(row: schema.Field, recorded: Sequence[str]) -> dict[str, Any]:
    """Return an array's attributes: units (empty: none), description, frame, names, arrays.

    ``recorded`` are the paths of the arrays that an episode of the store is made of.
    """
    out: dict[str, Any] = {"units": row.units, "description": row.description}
    if row.frame:
        out["frame"] = row.frame
    if row.names:
        out["names"] = list(row.names)
    if row == schema.DIGESTS:
        out["arrays"] = list(recorded)
    return out


def block_files(store: Place, row: schema.Field, block: int, rows: range) -> list[Place]:
    """Return the files that hold a block of a field; ``rows`` are the rows of the block.

    Files are numbered by block; those of videos by episode.
    """
    numbers = rows if row.is_video else range(block, block + 1)
    return [store / row.path / f"{number}{'.0' * len(row.dims)}" for number in numbers]


def block_number(name: str, row: schema.Field) -> int | None:
    """Return the number in the name of a field's file, as ``block_files`` names it; else None."""
    number = name.removesuffix(".0" * len(row.dims))
    is_number = number.isdecimal() and len(number) <= MOST_DIGITS
    return int(number) if is_number and f"{int(number)}{'.0' * len(row.dims)}" == name else None
