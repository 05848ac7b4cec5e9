"""Bounds of what a bag says of its topics: rosbags reads and parses all of it at once.

Definitions of messages take about 10 s for each megabyte of fields, and each topic has one.
"""

from __future__ import annotations

import os
import struct
from collections.abc import Iterator
from pathlib import Path
from typing import Any, BinaryIO

from mcap.opcode import Opcode
from rosbags.interfaces import Connection, MessageDefinition, MessageDefinitionFormat

from grasp_factory.core.limits import BAG_MESSAGE, BAG_RECORDS, BAG_TEXTS, BAG_TOPICS
from grasp_factory.errors import shown

METADATA = "metadata.yaml"
_FOOTER = struct.Struct("<BQQQI8s")
"""Opcode, length, start of the summary, of its offsets, checksum, magic."""
_RECORD = struct.Struct("<BQ")
_TOLD = MessageDefinition(MessageDefinitionFormat.NONE, "")


def check_texts(bag: Path, suffix: str) -> None:
    """Check what describes the topics of a bag, before rosbags reads it.

    Args:
        bag: the bag.
        suffix: of its format; empty for a folder.

    Raises:
        LimitError: if it is too large.
    """
    if not suffix:
        BAG_TEXTS.check((bag / METADATA).stat().st_size, bag / METADATA)
    for part in [bag] if suffix == ".mcap" else sorted(bag.glob("*.mcap")):
        topics = texts = 0
        with part.open("rb") as file:
            for count, (opcode, size) in enumerate(_summary(file), 1):
                BAG_RECORDS.check(count, part)
                if opcode == Opcode.CHANNEL:
                    topics, texts = topics + 1, texts + size
                    BAG_TOPICS.check(topics, part)
                    BAG_TEXTS.check(texts, part)


def _summary(file: BinaryIO) -> Iterator[tuple[int, int]]:
    """Yield opcode and size of each record after the messages of an MCAP file."""
    end = file.seek(-_FOOTER.size, os.SEEK_END)
    _, _, start, *_ = _FOOTER.unpack(file.read(_FOOTER.size))
    while 0 < start <= end - _RECORD.size:
        file.seek(start)
        opcode, size = _RECORD.unpack(file.read(_RECORD.size))
        yield opcode, size
        start += _RECORD.size + size


def bound_topics(bag: Path, part: Any) -> None:
    """Let a reader of rosbags check its topics when it is opened, before definitions are parsed.

    A definition that several topics have is parsed once.

    Args:
        bag: the bag, for messages.
        part: one of the readers of an ``AnyReader``, not open yet.
    """
    open_part = part.open

    def open_bounded() -> None:
        open_part()
        try:
            _bound(bag, part.connections)
        except BaseException:
            part.close()
            raise

    part.open = open_bounded


def _bound(bag: Path, connections: list[Connection]) -> None:
    """Check topics, and leave each definition in the first that has it alone."""
    BAG_TOPICS.check(len(connections), bag)
    seen: set[tuple[str, MessageDefinition]] = set()
    total = 0
    for k, connection in enumerate(connections):
        definition = (connection.msgtype, connection.msgdef)
        if definition in seen:
            connections[k] = connection._replace(msgdef=_TOLD)
            continue
        seen.add(definition)
        size = _parsed_size(connection.msgdef.data)
        BAG_MESSAGE.check(size, f"{bag}: {shown(connection.msgtype)}")
        total += size
    BAG_TEXTS.check(total, bag)


def _parsed_size(definition: str) -> int:
    """Return the characters of a definition without its comments, which cost little."""
    return sum(len(line.partition("#")[0].strip()) for line in definition.splitlines())
