"""The MCAP file of collected topics; a killed collector loses half a second at most.

https://mcap.dev/spec. The file of a killed collector lacks its end, and can be recovered.
"""

from __future__ import annotations

import os
import time
from pathlib import Path
from types import TracebackType
from typing import BinaryIO

from mcap.writer import CompressionType, Writer

from grasp_factory.core.output_file import is_in_store
from grasp_factory.errors import CaptureError, UsageError
from grasp_factory.writers.exporters.rosbag.bag_files import ros2_definition

_FLUSH_S = 0.5
_CHUNK = 4 * 2**20
_LIBRARY = "grasp-factory"
SUFFIX = ".mcap"


class TopicFile:
    """Messages on their way to the file. One thread uses it."""

    def __init__(self, path: Path) -> None:
        """Create the file.

        Raises:
            UsageError: if the name is taken, the folder does not exist, or it is inside a store.
        """
        self._path = path
        self._file = _created(path)
        self._writer = Writer(self._file, _CHUNK, CompressionType.NONE)
        self._writer.start(profile="ros2", library=_LIBRARY)
        self._channels: dict[str, int] = {}
        self._schemas: dict[str, int] = {}
        self._flushed = time.monotonic()

    def add(self, topic: str, kind: str, data: bytes, *, log_ns: int, publish_ns: int) -> None:
        """Write a message.

        Args:
            topic: its topic.
            kind: its type.
            data: CDR.
            log_ns: when it arrived, ns since the epoch.
            publish_ns: when it was sent, by its publisher's clock, ns since the epoch.

        Raises:
            CaptureError: if the disk fails.
        """
        try:
            if topic not in self._channels:
                schema = self._schema(kind)
                self._channels[topic] = self._writer.register_channel(topic, "cdr", schema)
            self._writer.add_message(self._channels[topic], log_ns, data, max(0, publish_ns))
            self.flush_if_due()
        except OSError as error:
            raise self._failed(error) from None

    def flush_if_due(self) -> None:
        """Bring to the disk what was written, every half second."""
        if time.monotonic() - self._flushed >= _FLUSH_S:
            self._writer.flush()
            self._file.flush()
            os.fsync(self._file.fileno())
            self._flushed = time.monotonic()

    def close(self) -> int:
        """Write the end of the file; return its size in bytes.

        Raises:
            CaptureError: if the disk fails.
        """
        try:
            with self._file:
                self._writer.finish()
                self._file.flush()
                os.fsync(self._file.fileno())
                return self._file.tell()
        except OSError as error:
            raise self._failed(error) from None

    def __enter__(self) -> TopicFile:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, _: BaseException | None, __: TracebackType | None
    ) -> None:
        """Close the file after an error, too: what was collected stays."""
        if not self._file.closed:
            self.close()

    def _schema(self, kind: str) -> int:
        if kind not in self._schemas:
            definition, _ = ros2_definition(kind)
            self._schemas[kind] = self._writer.register_schema(kind, "ros2msg", definition.encode())
        return self._schemas[kind]

    def _failed(self, error: OSError) -> CaptureError:
        return CaptureError(
            f"{self._path} cannot be written: {error.strerror or error}; what is in it stays"
        )


def _created(path: Path) -> BinaryIO:
    if path.suffix != SUFFIX:
        raise UsageError(f"{path}: unknown file format, valid: a name that ends in {SUFFIX}")
    if not path.parent.is_dir():
        raise UsageError(f"{path}: the folder {path.parent} does not exist")
    if is_in_store(path):
        raise UsageError(f"{path} is inside a store: choose another folder")
    try:
        return path.open("xb")
    except FileExistsError:
        raise UsageError(
            f"{path} exists, and nothing is overwritten: choose another name"
        ) from None
    except OSError as error:
        raise UsageError(f"{path} cannot be written: {error.strerror or error}") from None
