"""``session.json``: what a session recorded, and how it ended."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from datetime import UTC, datetime

from grasp_factory.capture.session.clock_state import ClockState
from grasp_factory.core.json_text import parsed
from grasp_factory.core.limits import DOCUMENT
from grasp_factory.core.place import Place
from grasp_factory.core.serialization import from_plain, to_plain
from grasp_factory.errors import CaptureError, ConfigError

RECORD, SETTINGS, DATA = "session.json", "session.yaml", "session.mcap"
RECOVERED = "session.recovered.mcap"
"""The file that ``capture recover`` writes beside a ``session.mcap`` without an end."""
CALIBRATION = "calibration"
METADATA = "grasp_factory.session"
"""The name of the MCAP metadata record with the settings."""
VERSION = 1


@dataclass(frozen=True, slots=True, kw_only=True)
class RecordedDevice:
    """What became of the samples of a device."""

    driver: str
    kind: str
    samples: int = 0
    """Samples that the driver gave."""
    written: int = 0
    """Of those, samples that are in the file."""
    dropped: int = 0
    """Samples that found the queue to the disk full."""
    unwritable: int = 0
    """Samples that no message can hold."""
    lost: int = 0
    """Samples that the device made and that did not arrive, by its own count."""
    bad_checksums: int = 0
    implausible: int = 0
    flagged: int = 0
    """Samples that the device itself marked as doubtful."""
    skipped_bytes: int = 0
    reconnects: int = 0
    longest_gap_s: float = 0.0
    rate_hz: float = 0.0
    """Samples per second from the first to the last one; 0 where it is not known."""


@dataclass(frozen=True, slots=True, kw_only=True)
class RecordedSession:
    """The content of ``session.json``."""

    version: int
    start: str
    """UTC, ISO 8601."""
    end: str
    ended: str
    """Why: interrupted, terminated, duration, hook, page, emergency_stop, disk_full, ..."""
    ended_cleanly: bool
    """Whether all that was queued is in the file, and the file has its end."""
    file: str = DATA
    """The MCAP file to read."""
    offset_ns: int = 0
    """The epoch's time minus this machine's monotonic time."""
    clock: ClockState | None = None
    """The system's clock when it started; None where that is not known."""
    bytes: int = 0
    devices: Mapping[str, RecordedDevice] = field(default_factory=dict)
    events: Mapping[str, int] = field(default_factory=dict)
    """How many there were, by name."""
    made_with: str = ""
    """The version of grasp-factory."""


def utc(epoch_ns: int) -> str:
    """Return a time as text.

    Raises:
        CaptureError: if no date has it.
    """
    try:
        return datetime.fromtimestamp(epoch_ns / 1e9, UTC).isoformat(timespec="milliseconds")
    except (OverflowError, ValueError, OSError):
        raise CaptureError(f"{epoch_ns} ns since 1970 is no date") from None


def write_record(folder: Place, record: RecordedSession) -> None:
    """Write ``session.json``, or replace it.

    Raises:
        OSError: if the disk fails.
    """
    text = json.dumps(to_plain(record), indent=2, allow_nan=False) + "\n"
    (folder / RECORD).write(text.encode(), durable=True)


def read_record(folder: Place) -> RecordedSession | None:
    """Return ``session.json``; None if there is none.

    Raises:
        CaptureError: if it is damaged.
        RefusedFileError: if it is a link or too large.
    """
    if not (folder / RECORD).exists():
        return None
    try:
        record = from_plain(RecordedSession, parsed((folder / RECORD).read_bytes(DOCUMENT)))
    except (ValueError, ConfigError) as error:
        raise CaptureError(f"{folder / RECORD} is damaged: {error}") from None
    if record.version != VERSION or record.file not in (DATA, RECOVERED):
        raise CaptureError(
            f"{folder / RECORD} is of version {record.version} with the file {record.file!r},"
            f" valid: version {VERSION} with {DATA} or {RECOVERED}; use a newer grasp-factory"
        )
    return record
