"""Readers of recorded sessions, and of the calibration files of cameras."""

from __future__ import annotations

import io
import tempfile
from pathlib import Path

import yaml
from fuzz.target import Target
from mcap.writer import CompressionType, Writer

from grasp_factory.capture.session.camera_info import camera_intrinsics
from grasp_factory.capture.session.messages import MessageEncoder
from grasp_factory.capture.session.recovery import recover
from grasp_factory.capture.session.session_reading import read_session

CAMCHAIN = {
    "camera_model": "pinhole",
    "intrinsics": [600.0, 601.0, 320.0, 240.0],
    "distortion_model": "radtan",
    "distortion_coeffs": [0.1, -0.2, 0.001, 0.002],
    "resolution": [640, 480],
}
MATRIX = {"width": 640, "height": 480, "K": [600, 0, 320, 0, 600, 240, 0, 0, 1], "D": [0.1]}


def parse(data: bytes) -> None:
    """Look at a session with such a file, and recover it."""
    with tempfile.TemporaryDirectory() as name:
        Path(name, "session.mcap").write_bytes(data)
        read_session(Path(name))
        recover(Path(name))


def examples() -> list[bytes]:
    """Return files with and without an end, with and without compression."""
    whole = [written(kind) for kind in (CompressionType.NONE, CompressionType.ZSTD)]
    return [*whole, whole[0][:-200]]


def written(compression: CompressionType) -> bytes:
    out = io.BytesIO()
    writer = Writer(out, chunk_size=200, compression=compression)
    writer.start(profile="ros2", library="test")
    writer.add_metadata("grasp_factory.session", {"start_ns": "5", "offset_ns": "3"})
    schema = writer.register_schema("std_msgs/msg/String", "ros2msg", b"string data")
    about = {"device": "a", "kind": "imu", "driver": "d", "device_sequence": "1"}
    numbers = writer.register_channel("/a/imu", "cdr", schema, about)
    events = writer.register_channel("/events", "cdr", schema, {})
    said = MessageEncoder().text({"event": "episode_start", "time_ns": 7})
    for k in range(4):
        writer.add_message(numbers, 10**9 + k, b"12345678", k, k)
        writer.add_message(events, 10**9 + k, said, k, 0)
    writer.finish()  # type: ignore[no-untyped-call]
    return out.getvalue()


TARGETS = {
    "session": Target(parse, examples),
    "camera calibration": Target(
        lambda data: camera_intrinsics(data, Path("c.yaml")),
        lambda: [yaml.safe_dump({"cam0": CAMCHAIN}).encode(), yaml.safe_dump(MATRIX).encode()],
    ),
}
