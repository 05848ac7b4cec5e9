"""Map the schema to Zarr arrays: shapes, chunks, shards, codec and attributes."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import zarr
from zarr.codecs import ZstdCodec

from grasp_factory.core import schema
from grasp_factory.core.config.factory_config import FactoryConfig

# Plain zstd for everything; docs/performance/scale.md compares other codecs. Level 3 makes an
# episode 1 % smaller and takes 50 % longer. Byte-shuffle would save 10 of the 57 KiB of streams;
# with images an episode has about 330 KiB, so that is not worth a second codec.
ZSTD_LEVEL = 1

# Chunk files are named 3.0.0 instead of c/3/0/0: no directory per shard, one fsync makes all
# names of an array durable, and the block's number leads every file name.
KEYS = {"name": "v2", "separator": "."}

# An empty chunk is written like any other. If it were left out, it would be read as the fill
# value, and a NaN or a -0.0 of the episode could be read with other bits than were written.
RUNTIME: Any = {"write_empty_chunks": True}


def shape(row: schema.Field, config: FactoryConfig, joints: int, n: int) -> tuple[int, ...]:
    """Return the shape of a field's array for ``n`` episodes."""
    return (n, *schema.shape(row, schema.sizes(config, joints)))


def create_array(
    root: zarr.Group, row: schema.Field, config: FactoryConfig, joints: int, n: int
) -> None:
    """Create a field's array, empty, with its attributes."""
    whole = shape(row, config, joints, n)
    block = (config.block_size, *whole[1:])
    if row.is_image:
        # A block of videos, padded to the longest attempt, would be too large to hold.
        shards = (1, *whole[1:]) if row.is_video else block
        chunks = (1, 1, *whole[2:])
    elif row.length_column:
        chunks, shards = (1, *whole[1:]), block
    else:
        chunks, shards = block, None
    root.create_array(
        row.path,
        shape=whole,
        chunks=chunks,
        shards=shards,
        dtype=str if row.dtype == "string" else row.dtype,
        fill_value=row.fill,
        compressors=[ZstdCodec(level=ZSTD_LEVEL)],
        chunk_key_encoding=KEYS,  # type: ignore[arg-type]
        dimension_names=dimension_names(row),
        attributes=attributes(row, config),
        config=RUNTIME,
    )


def dimension_names(row: schema.Field) -> list[str]:
    """Return a name for each dimension of a field's array; equal letters have equal names."""
    leaf, shared = row.path.rsplit("/", 1)[-1], schema.dimension_names()
    own = [
        shared[dim] if isinstance(dim, str) else f"{leaf}_{axis}"
        for axis, dim in enumerate(row.dims, start=1)
    ]
    return ["episode", *own]


def attributes(row: schema.Field, config: FactoryConfig) -> dict[str, Any]:
    """Return an array's attributes: units (empty: none), description, frame, names, arrays."""
    out: dict[str, Any] = {"units": row.units, "description": row.description}
    if row.frame:
        out["frame"] = row.frame
    if row.names:
        out["names"] = list(row.names)
    if row == schema.DIGESTS:
        out["arrays"] = list(schema.digested(config))
    return out


def block_files(store: Path, row: schema.Field, block: int, rows: range) -> list[Path]:
    """Return the files that hold a block of a field; ``rows`` are the rows of the block.

    Files are numbered by block; those of videos by episode.
    """
    numbers = rows if row.is_video else range(block, block + 1)
    return [store / row.path / f"{number}{'.0' * len(row.dims)}" for number in numbers]
