"""Packed segments: the columns of many blocks in one file, a derived copy that is fast to read.

``packed/0-1023.npz`` holds the columns of blocks 0 to 1023. It never changes: before one of its
blocks is rewritten, it is removed. Deleting ``packed`` loses nothing.
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from grasp_factory.core.atomic_file import fsync
from grasp_factory.writers.zarr.chunks import open_file

FOLDER = "packed"
BYTES = "bytes"
"""Member of a segment: the size in bytes of all files of its blocks, of every array."""
WORDS = ".words"
"""Suffix of the member that holds the words of a text column, by code."""
_NAME = re.compile(r"(\d+)-(\d+)\.npz")


@dataclass(frozen=True, slots=True)
class Segment:
    """The file of a range of blocks."""

    file: Path
    blocks: range

    @property
    def place(self) -> slice:
        """The slice of its blocks in an array of all blocks."""
        return slice(self.blocks.start, self.blocks.stop)

    def is_in(self, there: NDArray[np.bool_]) -> bool:
        """Return whether all its blocks are present; ``there`` says which blocks are, (B,)."""
        return self.blocks.stop <= len(there) and bool(there[self.place].all())

    def read(self, names: Iterable[str]) -> Mapping[str, NDArray[Any]] | None:
        """Return members by name, text decoded; None if the file is damaged or lacks one."""
        try:
            # If numpy opened the path, it would leave the file open when it is not a zip file.
            with open(open_file(self.file), "rb") as file:
                with np.load(file, allow_pickle=False) as members:
                    return {name: _member(members, name) for name in names}
        except Exception:  # zip, zlib and numpy raise any exception at damaged bytes
            return None


def segments(store: Path) -> list[Segment]:
    """Return the segments of a store, in the order of their blocks."""
    try:
        files = list((store / FOLDER).iterdir())
    except (FileNotFoundError, NotADirectoryError):
        return []
    found = ((file, _NAME.fullmatch(file.name)) for file in files)
    out = [Segment(f, range(int(name[1]), int(name[2]) + 1)) for f, name in found if name]
    return sorted(out, key=lambda segment: segment.blocks.start)


def unpack_block(store: Path, block: int) -> None:
    """Remove the segment that holds a block, durably, before the block is changed."""
    stale = [segment.file for segment in segments(store) if block in segment.blocks]
    for file in stale:
        file.unlink()
    if stale:
        fsync([store / FOLDER])


def coded(words: NDArray[Any]) -> tuple[NDArray[Any], NDArray[np.uint8]]:
    """Return a text column as codes of the same shape, and the sorted words by code, as JSON."""
    flat = words.ravel().tolist()
    known = sorted(set(flat))
    code = {word: k for k, word in enumerate(known)}
    codes = np.array([code[word] for word in flat], np.min_scalar_type(len(known)))
    text = json.dumps(known, ensure_ascii=False).encode()
    return codes.reshape(words.shape), np.frombuffer(text, np.uint8)


def _member(members: Any, name: str) -> NDArray[Any]:
    values: NDArray[Any] = members[name]
    if name + WORDS not in members:
        return values
    words = json.loads(members[name + WORDS].tobytes())
    return np.asarray(np.array(words, np.dtypes.StringDType())[values])
