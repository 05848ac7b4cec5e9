"""A change as a line of the log: JSON, whose last member is a checksum of the text before it."""

from __future__ import annotations

import json
import re
import zlib
from datetime import UTC, datetime
from typing import Any

from grasp_factory.core.json_text import parsed
from grasp_factory.core.serialization import is_integer
from grasp_factory.dataset.annotations.records import Change
from grasp_factory.dataset.annotations.values import checked, checked_who
from grasp_factory.errors import UsageError

MOST_ROWS = 10**9
_SEAL = re.compile(rb', "crc32": "([0-9a-f]{8})"\}')
_SEAL_LENGTH = len(', "crc32": "00000000"}')
_WHEN = re.compile(r"[0-9]{4}-[0-9]{2}-[0-9]{2}T[0-9]{2}:[0-9]{2}:[0-9]{2}\.[0-9]{3}Z")


def encode(change: Change) -> bytes:
    """Return a change as a line, including its line break."""
    record = {
        "when": change.when,
        "who": change.who,
        "row": change.row,
        "kind": change.kind,
        "value": change.value,
    }
    text = json.dumps(record, ensure_ascii=False, allow_nan=False)[:-1].encode()
    return b'%b, "crc32": "%08x"}\n' % (text, zlib.crc32(text))


def decode(line: bytes) -> Change:
    """Return the change that a line, without its line break, represents.

    Raises:
        ValueError: saying what is wrong with the line, but without any of its content.
    """
    sealed = _SEAL.fullmatch(line[-_SEAL_LENGTH:])
    text = line[:-_SEAL_LENGTH]
    if not sealed or int(sealed[1], 16) != zlib.crc32(text):
        raise ValueError("does not match its checksum" if sealed else "has no checksum")
    try:
        record = parsed(line)
        row, when = record["row"], record["when"]
        is_place = is_integer(row) and 0 <= row < MOST_ROWS
        if not (is_place and isinstance(when, str) and _WHEN.fullmatch(when)):
            raise ValueError
        datetime.fromisoformat(when)
        value = checked(record["kind"], record["value"])
        who = checked_who(record["who"])
    except (ValueError, KeyError, TypeError, UsageError):
        raise ValueError("is no change that this version knows") from None
    return Change(when=when, who=who, row=row, kind=record["kind"], value=value)


def to_record(change: Change) -> dict[str, Any]:
    """Return a change as JSON data."""
    return {name: getattr(change, name) for name in Change.__slots__}


def now() -> str:
    """Return the current time in the format of ``Change.when``."""
    text = datetime.now(UTC).isoformat(timespec="milliseconds")
    return text.replace("+00:00", "Z")
