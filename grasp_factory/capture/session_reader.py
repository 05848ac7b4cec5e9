"""Reading of a session's ``session.mcap``, record by record, in the order of the file.

A session may come from a stranger: call this in a process with limits
(``core/executors/import_process.py``).
MCAP: https://mcap.dev/spec
"""

from __future__ import annotations

import contextlib
import os
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import IO, Any, TypeAlias

from mcap.records import (
    Attachment,
    Channel,
    Chunk,
    DataEnd,
    Footer,
    Header,
    McapRecord,
    Message,
    Metadata,
    Schema,
)
from mcap.stream_reader import StreamReader, breakup_chunk

from grasp_factory.capture.reading_budget import CountedReads, ReadingBudget
from grasp_factory.capture.samples import DeviceKind
from grasp_factory.capture.session.mcap_scan import expanded
from grasp_factory.core.limits import CHUNK
from grasp_factory.core.place import place_of
from grasp_factory.errors import CaptureError, GraspFactoryError, shown

MCAP_FILE, SETTINGS_FILE, SUMMARY_FILE = "session.mcap", "session.yaml", "session.json"
RECOVERED_FILE = "session.recovered.mcap"
"""Written by ``capture recover`` beside the file of a killed recorder, and read in its place."""
CALIBRATION_FOLDER = "calibration"
MAGIC = b"\x89MCAP0\r\n"
"""With which an MCAP file begins and ends."""
SESSION_METADATA = "grasp_factory.session"
"""Name of the metadata record that has the settings."""
EVENTS_TOPIC = "/events"
_MOST_CHANNELS = 1000
_RECORD_HEAD = 9
"""Bytes of a record's opcode and length."""
_KINDS: Mapping[str, DeviceKind] = {kind.name.lower(): kind for kind in DeviceKind}

SessionRecord: TypeAlias = Header | Schema | Channel | Message | Attachment | Metadata


@dataclass(frozen=True, slots=True, kw_only=True)
class SessionTopic:
    """A topic of a session, and the device that it comes from."""

    name: str
    message_type: str
    """Such as ``sensor_msgs/msg/Imu``."""
    definition: str
    """The text of the message's definition in the file."""
    encoding: str
    """Of the messages: ``cdr``."""
    device: str
    """Name in session.yaml; empty for topics of no device, such as ``/events``."""
    driver: str
    kind: DeviceKind | None
    """None for topics of no device."""
    has_device_time: bool
    has_device_sequence: bool


@dataclass(frozen=True, slots=True, kw_only=True)
class SessionMessage:
    """A message with the times at which it was made and received."""

    topic: SessionTopic
    log_time_ns: int
    """Time of the host, ns since the epoch."""
    publish_time_ns: int
    """The device's own time if it has a clock."""
    sequence: int
    """The device's count modulo 2**32 if it has one."""
    data: bytes


@dataclass(slots=True, kw_only=True)
class SessionReader:
    """An open session; each call of a method reads the file from its start."""

    path: Path
    """The file, for messages."""
    stream: IO[bytes]
    size: int
    """Bytes of the file."""
    position: int = field(default=0, init=False)
    """Bytes that the running iteration has read."""

    def records(self) -> Iterator[SessionRecord]:
        """Yield the records of the data section; those of the index are left out.

        Raises:
            CaptureError: if the file is damaged, or was not ended.
            LimitError: for a record that is too large.
        """
        has_ended = False
        self._check_end()
        with _explained(self.path):
            for record in self._every_record():
                if isinstance(record, DataEnd | Footer):
                    has_ended = True
                elif not has_ended and isinstance(record, SessionRecord):
                    yield record

    def messages(self) -> Iterator[SessionMessage]:
        """Yield all messages.

        Raises:
            CaptureError: as ``records`` does, or for a message of an unknown topic.
        """
        schemas: dict[int, Schema] = {}
        topics: dict[int, SessionTopic] = {}
        for record in self.records():
            if isinstance(record, Message):
                topic = topics.get(record.channel_id)
                if topic is None:
                    raise _damaged(self.path, f"a message of channel {record.channel_id}, unknown")
                yield SessionMessage(
                    topic=topic,
                    log_time_ns=record.log_time,
                    publish_time_ns=record.publish_time,
                    sequence=record.sequence,
                    data=record.data,
                )
            elif isinstance(record, Schema):
                schemas[record.id] = record
            elif isinstance(record, Channel):
                topics[record.id] = topic_of(record, schemas.get(record.schema_id))
            if len(topics) > _MOST_CHANNELS:
                raise _damaged(self.path, f"more than {_MOST_CHANNELS} channels")

    def _check_end(self) -> None:
        """Raise CaptureError for a file that begins as MCAP and does not end so."""
        self.stream.seek(0)
        head = self.stream.read(len(MAGIC))
        self.stream.seek(max(0, self.size - len(MAGIC)))
        tail = self.stream.read(len(MAGIC))
        if head == MAGIC and (tail != MAGIC or self.size == len(MAGIC)):
            raise CaptureError(
                f"{self.path} has no end: the recording was stopped before it was complete; run"
                f" `grasp-factory capture recover {self.path.parent}`"
            )

    def _every_record(self) -> Iterator[McapRecord]:
        self.stream.seek(0)
        budget = ReadingBudget(self.stream.fileno(), self.path)
        counted: Any = CountedReads(self.stream.read, budget, self.size)
        reader = StreamReader(
            counted, emit_chunks=True, validate_crcs=True, record_size_limit=CHUNK.most
        )
        for record in reader.records:
            self.position = self.stream.tell()
            if isinstance(record, Chunk):
                CHUNK.check(record.uncompressed_size, f"{self.path}, expanded")
                yield from _records_in(record, budget)
            else:
                yield record


def _records_in(chunk: Chunk, budget: ReadingBudget) -> list[McapRecord]:
    """Return the records of a chunk; they are counted before they are in memory.

    Raises:
        ValueError: for a chunk that is damaged, or compressed as no session is.
        LimitError: for far more records, or expanded bytes, than a session has.
    """
    budget.expand(chunk.uncompressed_size if chunk.compression else 0)
    content = expanded(chunk.data, chunk.compression, chunk.uncompressed_size)
    at = 0
    while at < len(content):
        budget.count()
        at += _RECORD_HEAD + int.from_bytes(content[at + 1 : at + _RECORD_HEAD], "little")
    plain = replace(chunk, compression="", data=content)
    records: list[McapRecord] = breakup_chunk(plain, validate_crc=True)
    return records


@contextlib.contextmanager
def opened_session(path: Path) -> Iterator[SessionReader]:
    """Yield a reader of the session in a folder: of what was recovered, if it was.

    Links in the folder are not followed.

    Raises:
        CaptureError: if there is no session.
        IrregularFileError: if its file is a link, or no regular file.
    """
    folder = place_of(path)
    try:
        name = RECOVERED_FILE if (folder / RECOVERED_FILE).exists() else MCAP_FILE
        descriptor = (folder / name).open()
    except OSError as error:
        why = error.strerror or error
        raise CaptureError(
            f"{path} is no session: {MCAP_FILE} in it cannot be read ({why}); valid: a folder"
            " that `grasp-factory capture run` made"
        ) from None
    with os.fdopen(descriptor, "rb") as stream:
        yield SessionReader(path=path / name, stream=stream, size=os.fstat(descriptor).st_size)


def topic_of(channel: Channel, schema: Schema | None) -> SessionTopic:
    """Return what a channel's record says, and the schema of its messages."""
    told = channel.metadata
    kind = _KINDS.get(told.get("kind", ""))
    return SessionTopic(
        name=channel.topic,
        message_type=schema.name if schema else "",
        definition=schema.data.decode("utf-8", "replace") if schema else "",
        encoding=channel.message_encoding,
        device=told.get("device", ""),
        driver=told.get("driver", ""),
        kind=kind,
        has_device_time=told.get("device_time") == "1",
        has_device_sequence=told.get("device_sequence") == "1",
    )


@contextlib.contextmanager
def _explained(path: Path) -> Iterator[None]:
    """Turn whatever the library raises at a damaged file into one error."""
    try:
        yield
    except (MemoryError, GraspFactoryError, GeneratorExit):
        raise
    except Exception as error:
        raise _damaged(path, f"{type(error).__name__}: {error}") from None


def _damaged(path: Path, why: str) -> CaptureError:
    return CaptureError(f"{path} cannot be read: {shown(why)}")
