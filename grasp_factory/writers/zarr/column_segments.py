"""Packed segments: the columns of many blocks in one file, a derived copy that is fast to read.

``packed/0-1023.npz`` holds the columns of blocks 0 to 1023. It never changes: before one of its
blocks is rewritten, it is removed. Deleting ``packed`` loses nothing.
"""

from __future__ import annotations

import io
import json
import math
import re
import struct
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import IO, Any, NamedTuple, TypeVar
from zipfile import ZIP_STORED, ZipFile

import numpy as np
from numpy.typing import DTypeLike, NDArray

from grasp_factory.core.json_text import parsed
from grasp_factory.core.limits import SEGMENT
from grasp_factory.core.place import Place, fsync_places
from grasp_factory.errors import NO_DAMAGE
from grasp_factory.writers.zarr.budgets import TextBudget
from grasp_factory.writers.zarr.layout import MOST_DIGITS

T = TypeVar("T")
FOLDER = "packed"
BYTES = "bytes"
"""Member of a segment: the size in bytes of all files of its blocks, of every array."""
WORDS = ".words"
"""Suffix of the member that holds the words of a text column, by code."""
_NUMBER = rf"(0|[1-9]\d{{0,{MOST_DIGITS - 1}}})"
_NAME = re.compile(rf"{_NUMBER}-{_NUMBER}\.npz", re.ASCII)
_MOST_MEMBERS, _MOST_ENTRY_BYTES = 1000, 512
"""Members of a segment; an honest one has two for each column. Bytes of one in the directory."""
_MOST_WORDS_BYTES, _MOST_WORD_BYTES = 16 * 2**20, 256
"""Bytes of the words of a column, in all and for each of its codes; longer ones are not read."""
_MOST_HEADER_BYTES = 1024
_END_RECORD_BYTES = 22
_END = struct.Struct("<4s16x4s6xHIIH")
"""The end of a zip file: what may be a locator of a larger directory (Zip64), then the record of
the directory: its mark, members, bytes and place, and the length of a comment."""


class Form(NamedTuple):
    """The shape and the type that a column must have."""

    shape: tuple[int, ...]
    dtype: np.dtype[Any]


@dataclass(frozen=True, slots=True)
class Segment:
    """The file of a range of blocks."""

    file: Place
    blocks: range

    @property
    def place(self) -> slice:
        """The slice of its blocks in an array of all blocks."""
        return slice(self.blocks.start, self.blocks.stop)

    def is_in(self, there: NDArray[np.bool_]) -> bool:
        """Return whether all its blocks are present; ``there`` says which blocks are, (B,)."""
        return self.blocks.stop <= len(there) and bool(there[self.place].all())

    def block_bytes(self) -> int | None:
        """Return the size of all files of its blocks; None if the file is damaged."""
        return self._take(lambda members: int(_numbers(members, BYTES, (), np.int64)))

    def read(self, forms: Mapping[str, Form], text: TextBudget) -> list[NDArray[Any]] | None:
        """Return columns by path, text decoded; None if it is damaged, or one has another form.

        Raises:
            LimitError: if one is too large.
        """
        return self._take(
            lambda members: [_column(members, path, form, text) for path, form in forms.items()]
        )

    def _take(self, take: Callable[[ZipFile], T]) -> T | None:
        try:
            with open(self.file.open(), "rb") as file:
                _check_directory(file)
                with ZipFile(file) as members:
                    return take(members)
        except NO_DAMAGE:
            raise
        except Exception:  # zipfile and numpy raise any exception at damaged bytes
            return None


def segments(store: Place) -> list[Segment]:
    """Return the segments of a store, in the order of their blocks; some may share blocks."""
    found = ((file, _NAME.fullmatch(file.name)) for file in (store / FOLDER).glob("*.npz"))
    out = [Segment(f, range(int(name[1]), int(name[2]) + 1)) for f, name in found if name]
    return sorted((s for s in out if s.blocks), key=lambda segment: segment.blocks.start)


def apart(found: Iterable[Segment]) -> Iterator[Segment]:
    """Yield segments, in their order, without those that share blocks with an earlier one."""
    stop = 0
    for segment in found:
        if segment.blocks.start >= stop:
            stop = segment.blocks.stop
            yield segment


def unpack_block(store: Place, block: int) -> None:
    """Remove the segment that holds a block, durably, before the block is changed."""
    stale = [segment.file for segment in segments(store) if block in segment.blocks]
    for file in stale:
        file.unlink()
    if stale:
        fsync_places([store / FOLDER])


def coded(words: NDArray[Any]) -> tuple[NDArray[Any], NDArray[np.uint8]]:
    """Return a text column as codes of the same shape, and the sorted words by code, as JSON."""
    flat = words.ravel().tolist()
    known = sorted(set(flat))
    code = {word: k for k, word in enumerate(known)}
    codes = np.array([code[word] for word in flat], np.min_scalar_type(len(known)))
    text = json.dumps(known, ensure_ascii=False).encode()
    return codes.reshape(words.shape), np.frombuffer(text, np.uint8)


def _check_directory(file: IO[bytes]) -> None:
    """Check the size of a zip file's directory, which ``ZipFile`` reads as a whole.

    Raises:
        OSError, ValueError, struct.error: if no segment has such a directory.
    """
    size = file.seek(0, io.SEEK_END)
    file.seek(size - _END.size)
    locator, mark, count, length, start, comment = _END.unpack(file.read())
    is_plain = mark == b"PK\x05\x06" and locator != b"PK\x06\x07" and not comment
    is_small = count <= _MOST_MEMBERS and length <= count * _MOST_ENTRY_BYTES
    if not is_plain or not is_small or start + length != size - _END_RECORD_BYTES:
        raise ValueError("no directory of a segment")


def _column(members: ZipFile, path: str, form: Form, text: TextBudget) -> NDArray[Any]:
    if form.dtype.kind != "T":
        return _numbers(members, path, form.shape, form.dtype)
    codes = _numbers(members, path, form.shape, np.uint8, np.uint16, np.uint32)
    most = min(_MOST_WORDS_BYTES, 2 + codes.size * _MOST_WORD_BYTES)
    words = parsed(_array(members, path + WORDS, most).tobytes())
    lengths = np.array([len(word.encode()) for word in words], np.int64)
    text.add(int(lengths[codes].sum()))
    return np.asarray(np.array(words, np.dtypes.StringDType())[codes])


def _numbers(
    members: ZipFile, name: str, shape: tuple[int, ...], *valid: DTypeLike
) -> NDArray[Any]:
    """Return a member of a shape and of one of some types."""
    dtypes = [np.dtype(dtype) for dtype in valid]
    most = math.prod(shape) * max(dtype.itemsize for dtype in dtypes)
    values = _array(members, name, most)
    if values.shape != shape or values.dtype not in dtypes:
        raise ValueError(f"{name} is {values.dtype} of {values.shape}")
    return values


def _array(members: ZipFile, name: str, most: int) -> NDArray[Any]:
    """Return a member as an array; it must be as ``np.savez`` writes numbers, uncompressed.

    NumPy's own reader believes the header's shape, and expands what is compressed.

    Args:
        members: the file.
        name: the member's name.
        most: the most bytes that the array may have.
    """
    member = members.getinfo(f"{name}.npy")
    if member.compress_type != ZIP_STORED or member.file_size > most + _MOST_HEADER_BYTES:
        raise ValueError(f"{name} is compressed, or has {member.file_size} bytes")
    SEGMENT.check(member.file_size, f"{members.filename or FOLDER}: {name}")
    data = members.read(member)
    head = io.BytesIO(data)
    if np.lib.format.read_magic(head) != (1, 0):
        raise ValueError(f"{name} has another format")
    shape, is_fortran, dtype = np.lib.format.read_array_header_1_0(head)
    if (
        is_fortran
        or dtype.hasobject
        or math.prod(shape) * dtype.itemsize != len(data) - head.tell()
    ):
        raise ValueError(f"{name} is not what its header says")
    return np.frombuffer(data, dtype, offset=head.tell()).reshape(shape)
