"""Codecs of a store's arrays that expand a chunk to no more bytes than its shape says.

A few kilobytes of zeros can expand to gigabytes. Only codecs that such a limit is known for are
used: those of this package's layout, and those that other tools rewrite arrays with.
"""

from __future__ import annotations

import dataclasses
import math
import zlib
from collections.abc import Iterable
from typing import Any

from zarr.abc.codec import Codec
from zarr.codecs import (
    BloscCodec,
    BytesCodec,
    Crc32cCodec,
    GzipCodec,
    ShardingCodec,
    TransposeCodec,
    VLenUTF8Codec,
    ZstdCodec,
)
from zarr.core.array_spec import ArraySpec
from zarr.core.buffer import Buffer

from grasp_factory.core.limits import WORD
from grasp_factory.writers.zarr.chunks import content_size, most_bytes_of_words

_NAMES = "zstd, gzip, blosc, sharding_indexed, bytes, vlen-utf8, transpose, crc32c"
_GZIP = 16 + zlib.MAX_WBITS
"""``wbits`` of a gzip member."""


class _BoundedZstd(ZstdCodec):
    def _decode_sync(self, chunk_bytes: Buffer, chunk_spec: ArraySpec) -> Buffer:
        _check(content_size(chunk_bytes.to_bytes()), chunk_spec)
        return super()._decode_sync(chunk_bytes, chunk_spec)


class _BoundedBlosc(BloscCodec):
    def _decode_sync(self, chunk_bytes: Buffer, chunk_spec: ArraySpec) -> Buffer:
        head = chunk_bytes.to_bytes()[4:8]  # the size after decompression, little-endian
        _check(int.from_bytes(head, "little"), chunk_spec)
        return super()._decode_sync(chunk_bytes, chunk_spec)


class _BoundedGzip(GzipCodec):
    def _decode_sync(self, chunk_bytes: Buffer, chunk_spec: ArraySpec) -> Buffer:
        most = _most(chunk_spec)
        content = zlib.decompressobj(_GZIP).decompress(chunk_bytes.to_bytes(), most + 1)
        _check(len(content), chunk_spec)
        return chunk_spec.prototype.buffer.from_bytes(content)


class _BoundedWords(VLenUTF8Codec):
    def _decode_sync(self, chunk_bytes: Buffer, chunk_spec: ArraySpec) -> Any:
        _check(len(chunk_bytes), chunk_spec)
        # The decoder makes room for as many words as the chunk claims.
        count = int.from_bytes(chunk_bytes[:4].to_bytes(), "little")
        if count != math.prod(chunk_spec.shape):
            raise ValueError(f"a chunk of {count} words, valid: {math.prod(chunk_spec.shape)}")
        return super()._decode_sync(chunk_bytes, chunk_spec)


def bounded(codecs: Iterable[Codec]) -> tuple[Codec, ...]:
    """Return codecs that do the same within limits.

    Raises:
        ValueError: for a codec that no limit is known for.
    """
    return tuple(map(_bounded, codecs))


def _bounded(codec: Any) -> Codec:
    match codec:
        case ZstdCodec():
            return _BoundedZstd(level=codec.level, checksum=codec.checksum)
        case GzipCodec():
            return _BoundedGzip(level=codec.level)
        case BloscCodec():
            return _BoundedBlosc.from_dict(codec.to_dict())
        case ShardingCodec():
            inner = bounded(codec.codecs)
            return dataclasses.replace(codec, codecs=inner)
        case VLenUTF8Codec():
            return _BoundedWords()
        case BytesCodec() | TransposeCodec() | Crc32cCodec():
            return codec
    raise ValueError(f"codec {type(codec).__name__}, valid: {_NAMES}")


def _most(spec: ArraySpec) -> int:
    """Return the most bytes of a chunk; words are limited as in this package's layout."""
    dtype = spec.dtype.to_native_dtype()
    count = math.prod(spec.shape)
    return most_bytes_of_words(count) if dtype.kind == "T" else count * dtype.itemsize


def _check(size: int | None, spec: ArraySpec) -> None:
    most = _most(spec)
    if size is None or size > most:
        advice = f"; {WORD.advice}" if spec.dtype.to_native_dtype().kind == "T" else ""
        raise ValueError(f"a chunk of {size or 'unknown'} bytes, valid: up to {most}{advice}")
