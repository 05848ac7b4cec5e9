"""Reading an MCAP file record by record, as far as it is whole: also one without an end.

https://mcap.dev/spec. Sizes are checked before they are believed. Of chunks without compression,
as the recorder writes them, images are not read unless they are asked for.
"""

from __future__ import annotations

import os
import struct
import zlib
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from io import BytesIO
from typing import Any, TypeVar

import zstandard
from lz4.frame import LZ4FrameDecompressor
from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Attachment, Channel, Metadata, Schema

from grasp_factory.capture.reading_budget import ReadingBudget
from grasp_factory.core.regular_file import read_part
from grasp_factory.errors import CaptureError

MAGIC = b"\x89MCAP0\r\n"
_LEAST_PAIR = 8
"""Bytes of a pair of empty texts in a map."""
MOST_RECORD = 16 * 2**20
"""Bytes of a record that is read whole: a schema, a channel, metadata, a calibration file."""
MOST_KEPT = 64 * 2**20
"""Bytes of such records together; all of them are in memory."""
MOST_CHANNELS = 1000
MOST_CHUNK = 128 * 2**20
"""An image of 8K in colour has 100 MB."""
_LONGEST_NAME = 32
_WINDOW = 64 * 1024
_RECORD = struct.Struct("<BQ")
_CHUNK = struct.Struct("<QQQII")
"""Start, end, size before compression, checksum, length of the compression's name."""
_MESSAGE = struct.Struct("<HIQQ")
_LENGTH = struct.Struct("<Q")
_CUT = "the file is cut off in a record"
R = TypeVar("R")


class _DamagedRecordError(Exception):
    """From here on the file cannot be read."""


_DAMAGED = (_DamagedRecordError, McapError, struct.error, ValueError, OverflowError)
"""What a damaged record raises."""


class _FileBytes:
    """The bytes of a file; small pieces are read with those after them."""

    def __init__(self, descriptor: int) -> None:
        self._descriptor = descriptor
        self._window, self._at = b"", 0

    def read(self, at: int, size: int) -> bytes:
        place = at - self._at
        if size <= _WINDOW and not 0 <= place <= len(self._window) - size:
            self._window, self._at, place = os.pread(self._descriptor, _WINDOW, at), at, 0
        if size <= _WINDOW:
            data = self._window[place : place + size]
        else:
            data = read_part(self._descriptor, size, at)
        if len(data) != size:
            raise _DamagedRecordError(_CUT)
        return data


class _ChunkBytes:
    """The bytes of a chunk that was compressed."""

    def __init__(self, content: bytes) -> None:
        self._content = content

    def read(self, at: int, size: int) -> bytes:
        return self._content[at : at + size]


_Bytes = _FileBytes | _ChunkBytes


@dataclass(frozen=True, slots=True)
class MessageHead:
    """A message whose data is read when it is asked for."""

    channel_id: int
    sequence: int
    log_ns: int
    publish_ns: int
    size: int
    """Bytes of its data."""
    offset: int
    source: _Bytes
    """Where its data is."""

    def data(self) -> bytes:
        """Return the data."""
        return self.source.read(self.offset, self.size)


class McapScan:
    """A pass over a file.

    Attributes:
        descriptor: the open file.
        size: its bytes.
        channels: those found so far, by number.
        schemas: likewise.
        metadata: texts by record's name.
        attachments: small files in it.
        end: bytes from the start that are whole.
        is_complete: whether the file has its end, so that any reader takes it.
        is_compressed: whether a chunk so far was compressed.
        trouble: why reading stopped before the end; empty if it did not.
    """

    def __init__(
        self, descriptor: int, *, with_checksums: bool = False, where: object = "the file"
    ) -> None:
        """Begin.

        Args:
            descriptor: the open file.
            where: its name in messages.
            with_checksums: read the data of chunks too, and stop at one that is damaged.

        Raises:
            CaptureError: if it is no MCAP file.
        """
        self.channels: dict[int, Channel] = {}
        self.schemas: dict[int, Schema] = {}
        self.metadata: dict[str, dict[str, str]] = {}
        self.attachments: list[Attachment] = []
        self.end = len(MAGIC)
        self.is_complete = False
        self.is_compressed = False
        self.trouble = ""
        self.descriptor, self._with_checksums = descriptor, with_checksums
        self.size = os.fstat(descriptor).st_size
        self._file = _FileBytes(descriptor)
        self._budget, self._kept = ReadingBudget(descriptor, where), 0
        if self.size < len(MAGIC) or self._file.read(0, len(MAGIC)) != MAGIC:
            raise CaptureError("this is no MCAP file; valid: the folder of a session")

    @property
    def has_magic_end(self) -> bool:
        """Whether the last bytes are those of a file with its end."""
        return (
            self.size > len(MAGIC) and self._file.read(self.size - len(MAGIC), len(MAGIC)) == MAGIC
        )

    def messages(self) -> Iterator[MessageHead]:
        """Yield the messages in the order of the file; the attributes are filled meanwhile.

        Raises:
            LimitError: for far more records, or expanded bytes, than a session has.
        """
        at = self.end
        while at < self.size and not self.is_complete:
            self._budget.count()
            try:
                opcode, start, size = _record(self._file, at, self.size)
                if opcode == Opcode.FOOTER:
                    self.is_complete = self._file.read(start + size, len(MAGIC)) == MAGIC
                    size += len(MAGIC) if self.is_complete else 0
                elif opcode == Opcode.CHUNK:
                    yield from self._chunk(start, size)
                else:
                    self._note(self._file, opcode, start, size)
            except _DAMAGED as error:
                self.trouble = " ".join(str(error).split()) or "a damaged record"
                return
            at = self.end = start + size
        if not self.is_complete:
            self.trouble = "it has no end"

    def _chunk(self, start: int, size: int) -> Iterator[MessageHead]:
        """Yield the messages of a chunk, all or none."""
        source, at, end = self._opened_chunk(start, size)
        found = []
        while at < end:
            self._budget.count()
            opcode, inner, inner_size = _record(source, at, end)
            if opcode == Opcode.MESSAGE:
                found.append(self._head(source, inner, inner_size))
            else:
                self._note(source, opcode, inner, inner_size)
            at = inner + inner_size
        yield from found

    def _opened_chunk(self, start: int, size: int) -> tuple[_Bytes, int, int]:
        """Return where the records of a chunk are: what holds them, first byte, and end."""
        _, _, raw_size, checksum, named = _CHUNK.unpack(self._file.read(start, _CHUNK.size))
        at = start + _CHUNK.size
        if named > _LONGEST_NAME or raw_size > MOST_CHUNK or size > MOST_CHUNK:
            raise _DamagedRecordError(f"a chunk of {max(size, raw_size)} bytes")
        name = self._file.read(at, named).decode("ascii")
        (length,) = _LENGTH.unpack(self._file.read(at + named, _LENGTH.size))
        at += named + _LENGTH.size
        if at + length != start + size or (not name and length != raw_size):
            raise _DamagedRecordError("a chunk of another size than it says")
        self.is_compressed |= bool(name)
        self._budget.expand(raw_size if name else 0)
        if not (name or self._with_checksums):
            return self._file, at, at + length
        content = expanded(self._file.read(at, length), name, raw_size)
        if len(content) != raw_size or (checksum and zlib.crc32(content) != checksum):
            raise _DamagedRecordError("a chunk whose checksum is wrong")
        return _ChunkBytes(content), 0, raw_size

    def _head(self, source: _Bytes, start: int, size: int) -> MessageHead:
        if size < _MESSAGE.size:
            raise _DamagedRecordError("a message that is too short")
        channel, sequence, log_ns, publish_ns = _MESSAGE.unpack(source.read(start, _MESSAGE.size))
        if channel not in self.channels:
            raise _DamagedRecordError("a message of an unknown channel")
        at = start + _MESSAGE.size
        return MessageHead(channel, sequence, log_ns, publish_ns, start + size - at, at, source)

    def _note(self, source: _Bytes, opcode: int, start: int, size: int) -> None:
        """Remember a record that is no message."""
        if opcode in (Opcode.CHANNEL, Opcode.METADATA):  # the library reads each text of a map
            self._budget.count(size // _LEAST_PAIR)
        if opcode == Opcode.CHANNEL:
            channel = self._parsed(Channel.read, source, start, size)
            if channel.schema_id not in self.schemas or len(self.channels) >= MOST_CHANNELS:
                raise _DamagedRecordError("a channel without a schema, or too many channels")
            self.channels[channel.id] = channel
        elif opcode == Opcode.SCHEMA:
            schema = self._parsed(Schema.read, source, start, size)
            self.schemas[schema.id] = schema
            if len(self.schemas) > MOST_CHANNELS:
                raise _DamagedRecordError("too many schemas")
        elif opcode == Opcode.METADATA and len(self.metadata) < MOST_CHANNELS:
            metadata = self._parsed(Metadata.read, source, start, size)
            self.metadata[metadata.name] = metadata.metadata
        elif opcode == Opcode.ATTACHMENT and len(self.attachments) < MOST_CHANNELS:
            self.attachments.append(self._parsed(Attachment.read, source, start, size))

    def _parsed(self, read: Callable[[Any], R], source: _Bytes, start: int, size: int) -> R:
        self._kept += size
        if size > MOST_RECORD or self._kept > MOST_KEPT:
            raise _DamagedRecordError(f"records of {self._kept} bytes that are no messages")
        return read(ReadDataStream(BytesIO(source.read(start, size))))


def _record(source: _Bytes, at: int, end: int) -> tuple[int, int, int]:
    """Return opcode, start and size of the content of the record at ``at``."""
    if at + _RECORD.size > end:
        raise _DamagedRecordError(_CUT)
    opcode, size = _RECORD.unpack(source.read(at, _RECORD.size))
    start = at + _RECORD.size
    if size > end - start:
        raise _DamagedRecordError(_CUT)
    return opcode, start, size


def expanded(data: bytes, compression: str, size: int) -> bytes:
    """Return the content of a chunk, which must have ``size`` bytes if it is compressed.

    Raises:
        ValueError: for data that is damaged, or a compression that no session has.
    """
    if not compression:
        return data
    if compression not in _DECODERS:
        raise ValueError(f"a chunk with the compression {compression[:20]!r}, valid: zstd or lz4")
    try:
        content = _DECODERS[compression](data, size)
    except (RuntimeError, zstandard.ZstdError) as error:
        raise ValueError(f"a damaged chunk: {error}") from None
    if len(content) != size:
        raise ValueError("a chunk of another size than it says")
    return content


def _from_zstd(data: bytes, size: int) -> bytes:
    if zstandard.frame_content_size(data) not in (-1, size):
        raise ValueError("a chunk of another size than it says")
    return zstandard.ZstdDecompressor().decompress(data, max_output_size=size)


def _from_lz4(data: bytes, size: int) -> bytes:
    content: bytes = LZ4FrameDecompressor().decompress(data, max_length=size)
    return content


_DECODERS: Mapping[str, Callable[[bytes, int], bytes]] = {"zstd": _from_zstd, "lz4": _from_lz4}
"""Functions that return at most so many bytes."""
