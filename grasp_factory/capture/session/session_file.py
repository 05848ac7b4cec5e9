"""The MCAP file of a session while it is written.

https://mcap.dev/spec. Every record is written whole; after ``flush``, a killed recorder loses
nothing of what was added before: the file then lacks only its end, which ``recovery`` adds.
"""

from __future__ import annotations

import contextlib
import os
from collections.abc import Mapping
from functools import cache
from typing import Any, cast

from mcap.writer import CompressionType, Writer

from grasp_factory.capture.session.disk_sync import DiskSync
from grasp_factory.capture.session.session_config import Compression
from grasp_factory.writers.exporters.rosbag.bag_files import ros2_definition

CHUNK_BYTES = 4 * 2**20
"""A chunk is finished when it is larger, or at the next flush."""
LONGEST_TIME = 2**64
SEQUENCES = 2**32
LIBRARY = "grasp-factory"
_COMPRESSION = {Compression.NONE: CompressionType.NONE, Compression.ZSTD: CompressionType.ZSTD}


class WholeWrites:
    """A file that is written at a position: a write that fails leaves nothing of itself behind.

    Attributes:
        position: bytes that are in the file.
    """

    def __init__(self, descriptor: int) -> None:
        self.position = 0
        self._descriptor = descriptor

    def write(self, data: bytes) -> int:
        """Write all of the data.

        Raises:
            OSError: if the disk fails; the file then ends where it did before.
        """
        rest, at = memoryview(data), self.position
        try:
            while rest:
                done = os.pwrite(self._descriptor, rest, at)
                rest, at = rest[done:], at + done
        except OSError:
            with contextlib.suppress(OSError):
                os.ftruncate(self._descriptor, self.position)
            raise
        self.position = at
        return len(data)

    def tell(self) -> int:
        """Return the position."""
        return self.position

    def flush(self) -> None:
        """Do nothing: nothing is kept back."""


class SessionFile:
    """Messages, attachments and metadata on their way into the file. One thread uses it."""

    def __init__(self, descriptor: int, compression: Compression = Compression.NONE) -> None:
        """Start a file.

        Args:
            descriptor: an empty file, open for writing; the caller closes it after ``close``.
            compression: of its chunks.

        Raises:
            OSError: if the disk fails.
        """
        self._stream = WholeWrites(descriptor)
        self.sync = DiskSync(descriptor)
        self._writer = mcap_writer(self._stream, compression)
        self._channels: dict[str, int] = {}
        self._schemas: dict[str, int] = {}
        self._writer.start(profile="ros2", library=LIBRARY)

    @property
    def position(self) -> int:
        """Bytes that are in the file."""
        return self._stream.position

    def add_metadata(self, name: str, content: Mapping[str, str]) -> None:
        """Write a record of texts by name."""
        self._writer.add_metadata(name, dict(content))

    def add_attachment(self, name: str, kind: str, content: bytes, log_ns: int) -> None:
        """Write a file into the file.

        Args:
            name: its name.
            kind: its content type.
            content: its bytes.
            log_ns: when it was added, ns since the epoch.
        """
        self._writer.add_attachment(log_ns, log_ns, name, kind, content)

    def add_message(
        self,
        topic: str,
        kind: str,
        metadata: Mapping[str, str],
        data: bytes | memoryview,
        *,
        log_ns: int,
        publish_ns: int,
        sequence: int,
    ) -> None:
        """Write a message.

        Args:
            topic: its topic.
            kind: its type.
            metadata: of the topic's channel; the first message decides.
            data: CDR.
            log_ns: host time, ns since the epoch.
            publish_ns: the device's time; stored modulo 2**64.
            sequence: the device's count; stored modulo 2**32.
        """
        channel = self._channels.get(topic)
        if channel is None:
            channel = self._channels[topic] = self._writer.register_channel(
                topic, "cdr", self._schema(kind), dict(metadata)
            )
        self._writer.add_message(
            channel, log_ns, cast(bytes, data), publish_ns % LONGEST_TIME, sequence % SEQUENCES
        )

    def flush(self) -> None:
        """Hand what was added to the operating system, and ask for it to reach the disk.

        Raises:
            OSError: if the disk fails.
        """
        self._writer.flush()
        self.sync.ask()

    def close(self) -> None:
        """Write the end of the file, and wait for the disk.

        Raises:
            OSError: if the disk fails.
        """
        try:
            self._writer.finish()
        finally:
            self.sync.end()

    def _schema(self, kind: str) -> int:
        if kind not in self._schemas:
            definition = message_definition(kind)
            self._schemas[kind] = self._writer.register_schema(kind, "ros2msg", definition)
        return self._schemas[kind]


def mcap_writer(stream: WholeWrites, compression: Compression = Compression.NONE) -> Writer:
    """Return a writer of chunks."""
    return Writer(cast(Any, stream), CHUNK_BYTES, _COMPRESSION[compression])


@cache
def message_definition(kind: str) -> bytes:
    """Return the definition of a message of ROS 2 Humble."""
    return ros2_definition(kind)[0].encode()
