"""A copy of a session's file in which the bytes of some messages are others."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

from mcap.records import Attachment, Channel, Header, Message, Metadata, Schema
from mcap.writer import CompressionType, Writer

from grasp_factory.capture.ros_messages import STRING, definition_of, encoded, humble
from grasp_factory.capture.session_reader import (
    EVENTS_TOPIC,
    SessionMessage,
    SessionReader,
    SessionTopic,
    topic_of,
)
from grasp_factory.errors import CaptureError


class SessionCopy:
    """Writes the records of a session to another file, in the same order."""

    def __init__(self, reader: SessionReader, change: Callable[[SessionMessage], bytes]) -> None:
        """Take the session, and the function that returns the new bytes of a message."""
        self._reader, self._change = reader, change
        self._schemas: dict[int, Schema] = {}
        self._schema_ids: dict[int, int] = {0: 0}
        self._channels: dict[int, tuple[int, SessionTopic]] = {}
        self._last_ns = 0

    def write(
        self,
        path: Path,
        on_message: Callable[[], None],
        event: Mapping[str, Any],
    ) -> None:
        """Write the file, with one more event at the end.

        The event has the time of the last message, so that the same session gives the same bytes.

        Args:
            path: the new file.
            on_message: called after each message.
            event: its keys but for ``time_ns``.

        Raises:
            CaptureError: if the session is damaged.
            OSError: if the file cannot be written.
        """
        with path.open("xb") as file:
            writer = Writer(file, compression=CompressionType.ZSTD)
            is_started = False
            for record in self._reader.records():
                if isinstance(record, Header):
                    if not is_started:
                        writer.start(**asdict(record))
                    is_started = True
                elif not is_started:
                    raise CaptureError(f"{self._reader.path}: its file begins without a header")
                else:
                    self._add(writer, record)
                if isinstance(record, Message):
                    on_message()
            self._add_event(writer, event)
            writer.finish()

    def _add(
        self, writer: Writer, record: Schema | Channel | Message | Attachment | Metadata
    ) -> None:
        if isinstance(record, Message):
            self._add_message(writer, record)
        elif isinstance(record, Schema):
            if record.id not in self._schemas:
                self._schemas[record.id] = record
                self._schema_ids[record.id] = writer.register_schema(
                    record.name, record.encoding, record.data
                )
        elif isinstance(record, Channel):
            self._add_channel(writer, record)
        elif isinstance(record, Attachment):
            writer.add_attachment(
                record.create_time, record.log_time, record.name, record.media_type, record.data
            )
        else:
            writer.add_metadata(record.name, record.metadata)

    def _add_channel(self, writer: Writer, record: Channel) -> None:
        if record.id in self._channels:
            return
        schema = self._schema_ids.get(record.schema_id)
        if schema is None:
            raise CaptureError(f"{self._reader.path}: a channel of an unknown schema")
        new = writer.register_channel(
            record.topic, record.message_encoding, schema, record.metadata
        )
        self._channels[record.id] = new, topic_of(record, self._schemas.get(record.schema_id))

    def _add_message(self, writer: Writer, record: Message) -> None:
        if record.channel_id not in self._channels:
            raise CaptureError(f"{self._reader.path}: a message of an unknown channel")
        channel, topic = self._channels[record.channel_id]
        message = SessionMessage(
            topic=topic,
            log_time_ns=record.log_time,
            publish_time_ns=record.publish_time,
            sequence=record.sequence,
            data=record.data,
        )
        writer.add_message(
            channel, record.log_time, self._change(message), record.publish_time, record.sequence
        )
        self._last_ns = max(self._last_ns, record.log_time)

    def _add_event(self, writer: Writer, event: Mapping[str, Any]) -> None:
        channels = [new for new, topic in self._channels.values() if topic.name == EVENTS_TOPIC]
        if not channels:
            schema = writer.register_schema(STRING, "ros2msg", definition_of(STRING).encode())
            channels = [writer.register_channel(EVENTS_TOPIC, "cdr", schema)]
        text = json.dumps({**event, "time_ns": self._last_ns})
        data = encoded(humble().types[STRING](data=text), STRING)
        writer.add_message(channels[0], self._last_ns, data, self._last_ns)
