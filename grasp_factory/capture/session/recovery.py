"""Recovery of a session whose recorder was killed: a valid MCAP file beside the original."""

from __future__ import annotations

import fcntl
import os
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, replace
from itertools import chain
from pathlib import Path

from mcap.records import Channel

from grasp_factory import __version__
from grasp_factory.capture.session.mcap_scan import McapScan
from grasp_factory.capture.session.session_config import Compression
from grasp_factory.capture.session.session_file import LIBRARY, WholeWrites, mcap_writer
from grasp_factory.capture.session.session_reading import open_scan, session_place
from grasp_factory.capture.session.session_record import (
    DATA,
    METADATA,
    RECOVERED,
    VERSION,
    RecordedDevice,
    RecordedSession,
    read_record,
    utc,
    write_record,
)
from grasp_factory.core.place import Place, fsync_places
from grasp_factory.errors import CaptureError

KILLED = "killed"


@dataclass(frozen=True, slots=True, kw_only=True)
class Recovery:
    """What became of a session."""

    path: str
    """The file to read now."""
    was_complete: bool
    """Whether there was nothing to do."""
    messages: int
    last: str
    """Time of the last message, UTC; empty without messages."""
    lost_bytes: int
    """Bytes at the end that are no whole records."""
    reason: str
    """Why reading stopped there."""


def recover(path: Path) -> Recovery:
    """Write ``session.recovered.mcap`` with all whole messages, and ``session.json``.

    The original stays as it is. The new file appears when it is complete.

    Raises:
        CaptureError: if the path is no session, or it is being recorded, or was recovered before,
            or the disk fails.
        RefusedFileError: if a file of it is a link.
    """
    folder = session_place(path)
    read_record(folder)  # a damaged one is told before anything is written
    if (folder / RECOVERED).exists():
        raise CaptureError(f"{folder / RECOVERED} exists: this session was recovered before")
    try:
        return _recovered(folder)
    except OSError as error:
        what = error.strerror or error
        raise CaptureError(f"{path} cannot be recovered: {what}; the original stays") from None


def _recovered(folder: Place) -> Recovery:
    with open_scan(folder / DATA, with_checksums=True) as scan:
        _check_not_recorded(scan, folder)
        if scan.has_magic_end:
            counted = sum(1 for _ in scan.messages())
            if scan.is_complete:
                return _untouched(folder, counted)
    with open_scan(folder / DATA, with_checksums=True) as scan:
        counts, times = _copy(scan, folder)
        (folder / RECOVERED).partial.replace(folder / RECOVERED)
        fsync_places([folder])
        write_record(folder, _record(folder, scan, counts, times))
        return Recovery(
            path=str(folder / RECOVERED),
            was_complete=False,
            messages=counts.total(),
            last=utc(times[1]) if times else "",
            lost_bytes=scan.size - scan.end,
            reason=scan.trouble,
        )


def _untouched(folder: Place, messages: int) -> Recovery:
    return Recovery(
        path=str(folder / DATA),
        was_complete=True,
        messages=messages,
        last="",
        lost_bytes=0,
        reason="",
    )


def _check_not_recorded(scan: McapScan, folder: Place) -> None:
    try:
        fcntl.flock(scan.descriptor, fcntl.LOCK_SH | fcntl.LOCK_NB)
    except BlockingIOError:
        raise CaptureError(f"{folder} is being recorded: end it first, with Ctrl-C") from None


def _copy(scan: McapScan, folder: Place) -> tuple[Counter[int], tuple[int, int] | None]:
    """Write the new file; return messages by channel, and the times of the first and last one."""
    partial = (folder / RECOVERED).partial
    partial.unlink(missing_ok=True)
    descriptor = partial.create()
    try:
        heads = scan.messages()
        first = next(heads, None)
        compression = Compression.ZSTD if scan.is_compressed else Compression.NONE
        writer = mcap_writer(WholeWrites(descriptor), compression)
        writer.start(profile="ros2", library=LIBRARY)
        schemas: dict[int, int] = {}
        channels: dict[int, int] = {}
        counts: Counter[int] = Counter()
        times: tuple[int, int] | None = None
        for head in chain([first] if first else [], heads):
            channel = scan.channels[head.channel_id]
            if channel.id not in channels:
                schema = scan.schemas[channel.schema_id]
                if schema.id not in schemas:
                    schemas[schema.id] = writer.register_schema(
                        schema.name, schema.encoding, schema.data
                    )
                channels[channel.id] = writer.register_channel(
                    channel.topic, channel.message_encoding, schemas[schema.id], channel.metadata
                )
            writer.add_message(
                channels[channel.id],
                head.log_ns,
                head.data(),
                head.publish_ns,
                head.sequence,
            )
            counts[channel.id] += 1
            earliest, latest = times or (head.log_ns, head.log_ns)
            times = min(earliest, head.log_ns), max(latest, head.log_ns)
        for name, content in scan.metadata.items():
            writer.add_metadata(name, content)
        for file in scan.attachments:
            writer.add_attachment(
                file.create_time, file.log_time, file.name, file.media_type, file.data
            )
        writer.finish()
        os.fsync(descriptor)
    except BaseException:
        partial.unlink(missing_ok=True)
        raise
    finally:
        os.close(descriptor)
    return counts, times


def _record(
    folder: Place, scan: McapScan, counts: Mapping[int, int], times: tuple[int, int] | None
) -> RecordedSession:
    """Return ``session.json``: what it says already, and what is in the new file."""
    before = read_record(folder)
    size = (folder / RECOVERED).stat().st_size
    if before is not None:
        return replace(before, file=RECOVERED, bytes=size)
    stored = scan.metadata.get(METADATA, {})
    first, last = times or (0, 0)
    return RecordedSession(
        version=VERSION,
        start=utc(_number(stored.get("start_ns")) or first),
        end=utc(last),
        ended=KILLED,
        ended_cleanly=False,
        file=RECOVERED,
        offset_ns=_number(stored.get("offset_ns")),
        bytes=size,
        devices=_devices([(scan.channels[number], count) for number, count in counts.items()]),
        made_with=__version__,
    )


def _devices(counts: list[tuple[Channel, int]]) -> dict[str, RecordedDevice]:
    """Return the samples of each device: the messages of that topic which has most of them."""
    found: dict[str, RecordedDevice] = {}
    for channel, count in counts:
        about = channel.metadata
        if name := about.get("device"):
            most = max(count, found[name].written if name in found else 0)
            found[name] = RecordedDevice(
                driver=about.get("driver", ""),
                kind=about.get("kind", ""),
                samples=most,
                written=most,
            )
    return found


def _number(text: str | None) -> int:
    """Return the whole number in a text, 0 if there is none."""
    return int(text) if text and len(text) <= 20 and text.isdecimal() else 0
