"""Limits of what is read from files, so that a hostile file cannot exhaust memory or time.

A limit is far above what this package writes. A file that exceeds one is refused in one line, which
says how to raise the limit: ``grasp-factory --limit NAME=SIZE``, or the environment variable.
"""

from __future__ import annotations

import os
import re
from dataclasses import dataclass

from grasp_factory.core.text_format import size_text
from grasp_factory.errors import LimitError, UsageError, lookup, shown

VARIABLE = "GRASP_FACTORY_LIMITS"
"""Environment variable with raised limits, such as ``chunk=4GiB,log=1GiB``; children inherit it."""
_UNITS = {"": 1, "KiB": 2**10, "MiB": 2**20, "GiB": 2**30, "TiB": 2**40}
_SIZE = re.compile(r"(\d{1,15})\s*([KMGT]iB)?")


@dataclass(frozen=True, slots=True)
class Limit:
    """The largest size of one thing that is read."""

    name: str
    usual: int
    """Bytes, or a count, unless it was raised."""
    what: str
    """The thing, in a message."""
    is_count: bool = False
    """Whether the size is a count and not a number of bytes."""
    source: str = "store"
    """What is read, in a message."""

    @property
    def most(self) -> int:
        """The limit in this process.

        Raises:
            UsageError: if the environment variable cannot be read.
        """
        text = os.environ.get(VARIABLE, "")
        return parse(text).get(self.name, self.usual) if text else self.usual

    def check(self, size: int, where: object, *, so_far: bool = False) -> None:
        """Check the size of the thing at a place, a path.

        Args:
            size: bytes, or a count.
            where: the path.
            so_far: whether the thing may be larger than that.

        Raises:
            LimitError: if it exceeds the limit.
        """
        if size > self.usual and size > self.most:
            got, most = (f"{n:,}" if self.is_count else size_text(n) for n in (size, self.most))
            got += " or more" if so_far else ""
            raise LimitError(f"{where}: {self.what} of {got}, valid: up to {most}; {self.advice}")

    @property
    def advice(self) -> str:
        """The end of a message: how to raise the limit."""
        what = f"grasp-factory --limit {self.name}={'N' if self.is_count else 'SIZE'} ..."
        return f"if you trust this {self.source}, raise the limit: {what}"


DOCUMENT = Limit("document", 4 * 2**20, "a JSON document")
CHUNK = Limit("chunk", 256 * 2**20, "a chunk")
CHUNK_ROWS = Limit("chunk-rows", 10_000, "a number of rows of a chunk", is_count=True)
BLOCK = Limit("block", 512 * 2**20, "a block of episodes, expanded,")
COLUMN = Limit("column", 512 * 2**20, "a column of all rows")
WORDS = Limit("words", 256 * 2**20, "the text of columns that are read together")
WORD = Limit("word", 64 * 2**10, "a word of a column, on average over a chunk,")
EMBEDDED = Limit("embedded", 128 * 2**20, "embedded data")
SOURCE = Limit("source", 256 * 2**10, "the source of a plugin", source="file")
SEGMENT = Limit("segment", 256 * 2**20, "a column of a packed segment")
MESH = Limit("triangles", 50_000, "an object's number of triangles", is_count=True)
LOG = Limit("log", 8 * 2**20, "a log")
SNAPSHOT_FILE = Limit("snapshot-file", 16 * 2**20, "a segment of a snapshot")
SNAPSHOTS = Limit("snapshots", 10_000, "a number of snapshots", is_count=True)
SNAPSHOT_BYTES = Limit("snapshot-bytes", 24 * 2**20, "snapshots with a size")
SIGNED = Limit("signed", 128 * 2**20, "a list of signed files")
DEPTH = Limit("depth", 32, "a depth of folders", is_count=True)
ROWS = Limit("rows", 1_000_000, "a number of rows", is_count=True)
CHUNKS = Limit("chunks", 4000, "a number of chunks", is_count=True)
OBJECT = Limit("object", 2**30, "an object")
LISTED = Limit("listed", 5_000_000, "a number of listed objects", is_count=True)
LABELS = Limit("labels", 100, "a number of added labels", is_count=True)
SIMULATIONS = Limit("simulations", 1000, "a number of rows to simulate again", is_count=True)
LOST = Limit("lost", 30, "a number of lost rows beyond that of whole ones", is_count=True)
MEMORY = Limit("memory", 768 * 2**20, "the memory of a simulation from a store's recipe")
CPU = Limit("seconds", 8, "the CPU time of a simulation from a store's recipe", is_count=True)
VIDEO_PIXELS = Limit("video-pixels", 8 * 10**9, "a video with a number of pixels", is_count=True)
VIDEO_CPU = Limit("video-seconds", 3600, "the CPU time of a video", is_count=True)
IMPORT_MEMORY = Limit("import-memory", 768 * 2**20, "the memory of an import", source="file")
IMPORT_FILE = Limit("import-file", 4 * 2**30, "a file of an import", source="file")
IMPORT_CPU = Limit(
    "import-seconds", 3600, "the CPU time of an import", is_count=True, source="file"
)
BAG_TOPICS = Limit("bag-topics", 2000, "a number of topics", is_count=True, source="bag")
BAG_RECORDS = Limit(
    "bag-records", 200_000, "a number of records after the messages", is_count=True, source="bag"
)
BAG_TEXTS = Limit("bag-texts", 2**19, "descriptions of topics and messages", source="bag")
BAG_MESSAGE = Limit("bag-message", 128 * 2**10, "the definition of a message", source="bag")
SESSION_MEMORY = Limit(
    "session-memory", 768 * 2**20, "the memory to read a session", source="session"
)
SESSION_FILE = Limit("session-file", 64 * 2**30, "a file of a session", source="session")
SESSION_CPU = Limit(
    "session-seconds", 86_400, "the CPU time to read a session", is_count=True, source="session"
)
EXPANDED = Limit("expanded", 2**30, "data beyond 200 times the bytes on the disk", source="session")
RECORDS = Limit(
    "records", 100_000, "a number of records beyond one in 8 bytes on the disk", is_count=True,
    source="session",
)  # fmt: skip
PIXELS = Limit("pixels", 64_000_000, "a number of pixels", is_count=True, source="image")
MODEL = Limit("model", 256 * 2**20, "a model", source="model")
LIMITS = {
    limit.name: limit
    for limit in (
        DOCUMENT,
        CHUNK,
        CHUNK_ROWS,
        BLOCK,
        COLUMN,
        WORDS,
        WORD,
        EMBEDDED,
        SOURCE,
        SEGMENT,
        MESH,
        LOG,
        SNAPSHOT_FILE,
        SNAPSHOTS,
        SNAPSHOT_BYTES,
        SIGNED,
        DEPTH,
        ROWS,
        CHUNKS,
        OBJECT,
        LISTED,
        LABELS,
        SIMULATIONS,
        LOST,
        MEMORY,
        CPU,
        VIDEO_PIXELS,
        VIDEO_CPU,
        IMPORT_MEMORY,
        IMPORT_FILE,
        IMPORT_CPU,
        BAG_TOPICS,
        BAG_RECORDS,
        BAG_TEXTS,
        BAG_MESSAGE,
        SESSION_MEMORY,
        SESSION_FILE,
        SESSION_CPU,
        EXPANDED,
        RECORDS,
        PIXELS,
        MODEL,
    )
}


def parse(text: str) -> dict[str, int]:
    """Return limits by name from a text such as ``chunk=4GiB,log=1GiB``.

    Raises:
        UsageError: for an unknown name, or a size that is no number of bytes.
    """
    out = {}
    for part in filter(None, text.split(",")):
        name, _, size = part.partition("=")
        lookup(LIMITS, "limit", name)
        found = _SIZE.fullmatch(size)
        if not found:
            raise UsageError(f"limit {name}: size {shown(size)}, valid: such as 512MiB or 4GiB")
        out[name] = int(found[1]) * _UNITS[found[2] or ""]
    return out
