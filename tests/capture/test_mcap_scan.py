"""Reading of session files that are cut off, damaged or hostile."""

from __future__ import annotations

import io
import json
import os
import struct
from collections.abc import Callable
from pathlib import Path

import pytest
import zstandard
from hypothesis import given, settings
from hypothesis import strategies as st
from mcap.writer import CompressionType, Writer
from support.scale import scaled

from grasp_factory.capture.session import mcap_scan, session_reading
from grasp_factory.capture.session.mcap_scan import MAGIC, McapScan
from grasp_factory.capture.session.recovery import recover
from grasp_factory.capture.session.session_reading import missing, read_event, read_session
from grasp_factory.capture.session_reader import opened_session
from grasp_factory.core.limits import RECORDS
from grasp_factory.errors import CaptureError, GraspFactoryError, LimitError

N = 40


def written(compression: CompressionType = CompressionType.NONE, size: int = 100) -> bytes:
    """Return a small file: ``N`` messages in several chunks, metadata and an attachment."""
    out = io.BytesIO()
    writer = Writer(out, chunk_size=500, compression=compression)
    writer.start(profile="ros2", library="test")
    writer.add_metadata("grasp_factory.session", {"start_ns": "5", "offset_ns": "3"})
    writer.add_attachment(1, 1, "calibration/a.yaml", "text/yaml", b"a: 1")
    schema = writer.register_schema("std_msgs/msg/String", "ros2msg", b"string data")
    about = {"device": "a", "kind": "imu", "driver": "d", "device_sequence": "1"}
    channel = writer.register_channel("/a/imu", "cdr", schema, about)
    for k in range(N):
        writer.add_message(channel, 10**9 + k * 10**7, bytes([k]) * size, k, k)
    writer.finish()
    return out.getvalue()


WHOLE = written()


def scanned(content: bytes, folder: Path, *, checked: bool = True) -> tuple[McapScan, list[bytes]]:
    file = folder / "session.mcap"
    file.write_bytes(content)
    descriptor = os.open(file, os.O_RDONLY)
    try:
        scan = McapScan(descriptor, with_checksums=checked)
        return scan, [head.data() for head in scan.messages()]
    finally:
        os.close(descriptor)


@pytest.mark.parametrize("compression", [CompressionType.NONE, CompressionType.ZSTD])
def test_a_whole_file_is_read_whole(compression: CompressionType, tmp_path: Path) -> None:
    scan, data = scanned(written(compression), tmp_path)
    assert data == [bytes([k]) * 100 for k in range(N)]
    assert (scan.is_complete, scan.trouble, scan.end) == (True, "", scan.size)
    assert scan.metadata["grasp_factory.session"]["start_ns"] == "5"
    assert [file.data for file in scan.attachments] == [b"a: 1"]


@settings(max_examples=scaled(60, 600))
@given(st.integers(len(MAGIC), len(WHOLE) - 1))
def test_a_file_that_is_cut_off_anywhere_gives_its_first_messages(
    tmp_path_factory: pytest.TempPathFactory, length: int
) -> None:
    folder = tmp_path_factory.mktemp("cut")
    scan, data = scanned(WHOLE[:length], folder)
    assert data == [bytes([k]) * 100 for k in range(len(data))]
    assert not scan.is_complete
    assert scan.end <= length
    assert scan.trouble
    found = recover(folder)
    assert found.messages == len(data)
    assert found.lost_bytes == length - scan.end
    again, copied = scanned((folder / "session.recovered.mcap").read_bytes(), folder)
    assert again.is_complete
    assert copied == data


@settings(max_examples=scaled(150, 3000))
@given(st.lists(st.tuples(st.integers(8, len(WHOLE) - 1), st.integers(1, 255)), max_size=4))
def test_a_file_with_any_bytes_changed_is_read_or_refused(
    tmp_path_factory: pytest.TempPathFactory, changes: list[tuple[int, int]]
) -> None:
    content = bytearray(WHOLE)
    for place, flip in changes:
        content[place] ^= flip
    folder = tmp_path_factory.mktemp("changed")
    for checked in (False, True):
        scanned(bytes(content), folder, checked=checked)
    for read in (read_session, recover):
        try:
            read(folder)
        except GraspFactoryError:
            pass


def record(opcode: int, content: bytes, size: int | None = None) -> bytes:
    return struct.pack("<BQ", opcode, len(content) if size is None else size) + content


def chunk(data: bytes, *, size: int | None = None, compression: bytes = b"") -> bytes:
    raw = len(data) if size is None else size
    head = struct.pack("<QQQII", 0, 0, raw, 0, len(compression)) + compression
    return record(6, head + struct.pack("<Q", len(data)) + data)


@pytest.mark.parametrize(
    "content",
    [
        record(3, b"x" * 20, 2**63),
        record(3, struct.pack("<HI", 1, 2**32 - 1) + b"x"),
        record(6, b"short"),
        chunk(b"", size=2**62, compression=b"zstd"),
        chunk(b"\x28\xb5\x2f\xfd" + b"\xff" * 20, size=2**20, compression=b"zstd"),
        chunk(b"abc", compression=b"lz4"),
        chunk(record(5, struct.pack("<HIQQ", 7, 0, 0, 0))),
        chunk(record(5, b"short")),
        chunk(record(4, struct.pack("<HHI", 1, 99, 0))),
        chunk(b"\x05" + b"\xff" * 8),
    ],
)
def test_a_hostile_record_ends_the_reading(content: bytes, tmp_path: Path) -> None:
    scan, data = scanned(MAGIC + record(1, struct.pack("<II", 0, 0)) + content, tmp_path)
    assert data == []
    assert scan.trouble
    assert not scan.is_complete


HEAD = MAGIC + record(1, struct.pack("<II", 0, 0))


def read_by_library(folder: Path) -> object:
    with opened_session(folder) as reader:
        return list(reader.messages())


@pytest.mark.parametrize("read", [read_session, recover, read_by_library])
@pytest.mark.parametrize("what", ["a file of holes", "a chunk that is compressed"])
def test_far_more_records_than_bytes_are_refused(
    tmp_path: Path, what: str, read: Callable[[Path], object]
) -> None:
    raw = record(0x80, b"") * (2 * RECORDS.usual)
    packed = chunk(zstandard.compress(raw), size=len(raw), compression=b"zstd")
    with (tmp_path / "session.mcap").open("wb") as file:
        file.write(HEAD)
        if what == "a file of holes":
            file.seek(10 * RECORDS.usual)
        else:
            file.write(packed + record(2, bytes(20)))
        file.write(MAGIC)
    with pytest.raises(LimitError, match="a number of records beyond one in 8 bytes on the disk"):
        read(tmp_path)
    assert [file.name for file in tmp_path.iterdir()] == ["session.mcap"]


@pytest.mark.parametrize("opcode", [4, 12], ids=["a channel", "metadata"])
def test_a_map_of_millions_of_empty_texts_is_not_read(tmp_path: Path, opcode: int) -> None:
    size = 16 * RECORDS.usual
    before = struct.pack("<HHII", 1, 1, 0, 0) if opcode == 4 else struct.pack("<I", 0)
    raw = record(opcode, before + struct.pack("<I", size) + bytes(size))
    packed = chunk(zstandard.compress(raw), size=len(raw), compression=b"zstd")
    (tmp_path / "session.mcap").write_bytes(HEAD + packed + record(2, bytes(20)) + MAGIC)
    with pytest.raises(LimitError, match="a number of records beyond one in 8 bytes on the disk"):
        read_session(tmp_path)


def test_events_are_read_up_to_a_size(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(session_reading, "MOST_EVENT_BYTES", 200)
    text = b'{"event": "alarm"}\0'
    data = bytes([0, 1, 0, 0]) + struct.pack("<I", len(text)) + text
    names = b"".join(struct.pack("<I", len(n)) + n for n in (b"/events", b"cdr"))
    kind = b"".join(
        struct.pack("<I", len(n)) + n for n in (b"std_msgs/msg/String", b"ros2msg", b"string data")
    )
    about = record(3, struct.pack("<H", 1) + kind)
    about += record(4, struct.pack("<HH", 1, 1) + names + struct.pack("<I", 0))
    message = record(5, struct.pack("<HIQQ", 1, 0, 0, 0) + data)
    (tmp_path / "session.mcap").write_bytes(HEAD + chunk(about + 20 * message))
    assert len(read_session(tmp_path).events) == 200 // len(data)


def test_chunks_that_expand_to_gigabytes_are_refused(tmp_path: Path) -> None:
    size = 125 * 2**20
    schema, about = struct.pack("<HIII", 1, 0, 0, 0), struct.pack("<HHIII", 1, 1, 0, 0, 0)
    with (tmp_path / "session.mcap").open("wb") as file:
        file.write(HEAD + record(3, schema) + record(4, about))
        for _ in range(10):
            end = file.tell() + 9 + 40 + size
            message = record(5, struct.pack("<HIQQ", 1, 0, 0, 0), size - 9)
            file.write(struct.pack("<BQQQQIIQ", 6, 40 + size, 0, 0, size, 0, 0, size) + message)
            file.seek(end)
        file.write(MAGIC)
    with pytest.raises(LimitError, match=r"data beyond 200 times the bytes on the disk of 1\."):
        read_session(tmp_path)


def test_records_that_would_fill_the_memory_end_the_reading(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(mcap_scan, "MOST_KEPT", 9000)
    schemas = b"".join(
        record(3, struct.pack("<HIII", k, 0, 0, 1000) + bytes(1000)) for k in range(9)
    )
    scan, _ = scanned(HEAD + schemas, tmp_path)
    assert "bytes that are no messages" in scan.trouble


def test_what_is_no_session_is_refused_in_one_line(tmp_path: Path) -> None:
    with pytest.raises(CaptureError, match=r"is no session: it has no session\.mcap"):
        read_session(tmp_path)
    (tmp_path / "session.mcap").write_bytes(b"hello, this is text")
    with pytest.raises(CaptureError, match="this is no MCAP file"):
        recover(tmp_path)
    with pytest.raises(CaptureError, match="is no session: No such file"):
        read_session(tmp_path / "nothing")


def test_links_in_a_session_are_not_followed(tmp_path: Path) -> None:
    secret = tmp_path / "secret"
    secret.write_bytes(WHOLE)
    folder = tmp_path / "s"
    folder.mkdir()
    (folder / "session.mcap").symlink_to(secret)
    for read in (read_session, recover):
        with pytest.raises(GraspFactoryError, match="is a link"):
            read(folder)


def test_recovery_writes_through_no_link(tmp_path: Path) -> None:
    mine = tmp_path / "mine"
    mine.write_text("mine")
    folder = tmp_path / "s"
    folder.mkdir()
    (folder / "session.mcap").write_bytes(WHOLE[:-40])
    (folder / "session.recovered.mcap.partial").symlink_to(mine)
    (folder / "session.json").symlink_to(mine)
    with pytest.raises(GraspFactoryError, match="is a link"):
        recover(folder)
    assert mine.read_text() == "mine"


@given(st.integers(0, 2**32 - 1), st.integers(1, 10_000))
def test_missing_numbers_are_counted_across_the_wrap(start: int, step: int) -> None:
    assert missing(start, (start + step) % 2**32) == step - 1


def test_a_count_that_begins_again_is_no_loss() -> None:
    assert missing(None, 7) == 0
    assert missing(10_000, 0) == 0
    assert missing(5, 5) == 0


def repr_of(number: object) -> str:
    return repr(number)[:10]


@pytest.mark.parametrize("key", ["time_ns", "count"])
@pytest.mark.parametrize("number", [10**400, 2**63, "5", [], 1.5, True], ids=repr_of)
def test_a_number_that_no_recorder_writes_is_no_event(key: str, number: object) -> None:
    text = json.dumps({"event": "alarm", key: number}).encode() + b"\0"
    with pytest.raises(CaptureError, match="is damaged"):
        read_event(b"\0\1\0\0" + struct.pack("<I", len(text)) + text)


@given(st.binary(max_size=60))
def test_any_bytes_are_an_event_or_an_error(data: bytes) -> None:
    with pytest.raises(CaptureError, match="is damaged"):
        read_event(data)
