"""Join shards to one that has the chunks of all, without decompressing them."""

from __future__ import annotations

import contextlib
import os
from collections.abc import Sequence

import google_crc32c
import numpy as np

from grasp_factory.core.place import Place
from grasp_factory.writers.zarr.chunks import ABSENT, ShardFile

_PART = 1 << 20


def join_shards(
    sources: Sequence[Place], target: Place, *, chunks: int, room: int, chunk_bytes: int
) -> None:
    """Write a shard with the chunks of several shards, one after another.

    The result has the bytes that ``encoding.packed_shard`` makes of the same chunks.

    Args:
        sources: shards as ``packed_shard`` makes them. Only the last may lack chunks.
        target: the new file; it is written as ``partial`` first.
        chunks: of each source.
        room: chunks of the result.
        chunk_bytes: bytes of a chunk, decompressed.

    Raises:
        ValueError: if a source has another layout.
        OSError: if a source is missing, or the disk fails.
    """
    index = np.full((room, 2), ABSENT, "<u8")
    partial, offset = target.partial, 0
    partial.unlink(missing_ok=True)
    try:
        with os.fdopen(partial.create(), "wb") as out:
            for k, source in enumerate(sources):
                with ShardFile(source.parent, source.name, chunks) as shard:
                    lengths = shard.chunk_lengths(chunk_bytes)
                    if len(lengths) < chunks and k < len(sources) - 1:
                        raise ValueError(f"a shard of {len(lengths)} chunks, valid: {chunks}")
                    ends = offset + np.cumsum(lengths, dtype=np.uint64)
                    rows = slice(k * chunks, k * chunks + len(lengths))
                    index[rows, 0], index[rows, 1] = ends - lengths, lengths
                    for part in shard.parts(_PART):
                        out.write(part)
                        offset += len(part)
            table = index.tobytes()
            out.write(table + google_crc32c.value(table).to_bytes(4, "little"))
    except BaseException:
        with contextlib.suppress(OSError):
            partial.unlink(missing_ok=True)
        raise
    partial.replace(target)
