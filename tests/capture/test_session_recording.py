"""Real recorders in processes of their own: how they end, what is lost, and what stays readable."""

from __future__ import annotations

import hashlib
import json
import resource
import signal
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from mcap.exceptions import McapError
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from support.session_run import ARM, CAMERA, IMU, WRENCH, SessionRun, device, recording

from grasp_factory.capture.session.mcap_scan import McapScan
from grasp_factory.capture.session.recovery import recover
from grasp_factory.capture.session.session_reading import read_session
from grasp_factory.errors import CaptureError

ALL = {
    "front": device(CAMERA, with_depth=True),
    "imu": IMU,
    "wrist": WRENCH,
    "skin": {"driver": "ticking_taxels", "rate_hz": 50, "settings": {"rate_hz": 50}},
    "arm": ARM,
}


def decoded(file: Path) -> Iterator[tuple[Any, Any, Any]]:
    """Yield channel, message and decoded message, as an independent reader finds them."""
    with file.open("rb") as stream:
        reader = make_reader(stream, decoder_factories=[DecoderFactory()])
        for _, channel, message, content in reader.iter_decoded_messages():
            yield channel, message, content


def events_of(file: Path) -> list[dict[str, Any]]:
    found = decoded(file)
    return [json.loads(content.data) for channel, _, content in found if channel.topic == "/events"]


def compressions(file: Path) -> set[str]:
    """Return the compressions of the chunks of a file."""
    with file.open("rb") as stream:
        summary = make_reader(stream).get_summary()
    assert summary
    return {chunk.compression for chunk in summary.chunk_indexes}


@pytest.fixture(scope="module")
def session(tmp_path_factory: pytest.TempPathFactory) -> SessionRun:
    """Return a session of all kinds of devices that has ended."""
    folder = tmp_path_factory.mktemp("session")
    (folder / "front.yaml").write_text(
        "cam0: {camera_model: pinhole, intrinsics: [60, 61, 31.5, 23.5], distortion_model: radtan,"
        " distortion_coeffs: [0.1, -0.2, 0.001, 0.002], resolution: [64, 48]}"
    )
    devices = ALL | {"front": {**ALL["front"], "calibration": "front.yaml"}}
    with recording(folder, devices, "--duration", 2, operator="me", tags=["wet"]) as run:
        assert run.wait() == 0, run.stderr
        return run


class TestASession:
    def test_all_that_the_devices_gave_is_in_the_file(self, session: SessionRun) -> None:
        record = session.record()
        assert (record["ended"], record["ended_cleanly"]) == ("duration", True)
        counts: dict[str, int] = {}
        for channel, _, _ in decoded(session.data):
            counts[channel.topic] = counts.get(channel.topic, 0) + 1
        for name, counted in record["devices"].items():
            assert counted["written"] == counted["samples"] - counted["dropped"] > 0
            topics = [topic for topic in counts if topic.startswith(f"/{name}/")]
            assert topics
            assert {counts[topic] for topic in topics} == {counted["written"]}

    def test_channels_name_device_driver_and_kind(self, session: SessionRun) -> None:
        with session.data.open("rb") as stream:
            summary = make_reader(stream).get_summary()
        assert summary is not None
        found = {channel.topic: channel for channel in summary.channels.values()}
        assert found["/imu/imu"].metadata == {
            "device": "imu",
            "driver": "ticking_imu",
            "kind": "imu",
            "device_time": "1",
            "device_sequence": "1",
        }
        kinds = {topic: summary.schemas[c.schema_id].name for topic, c in found.items()}
        assert kinds["/front/depth"] == "sensor_msgs/msg/Image"
        assert kinds["/wrist/wrench"] == "geometry_msgs/msg/WrenchStamped"

    def test_raw_times_are_those_of_the_device_and_of_the_host(self, session: SessionRun) -> None:
        record, before = session.record(), None
        for channel, message, content in decoded(session.data):
            if channel.topic != "/wrist/wrench":
                continue
            stamp = content.header.stamp.sec * 10**9 + content.header.stamp.nanosec
            assert stamp == message.log_time
            number = message.sequence
            assert message.publish_time == 10**9 + number * 2_000_000  # at 500 Hz
            assert before is None or number == before + 1
            before = number
            assert abs(message.log_time - record["offset_ns"]) < 2**62

    def test_values_are_those_of_the_samples(self, session: SessionRun) -> None:
        seen = {}
        for channel, message, content in decoded(session.data):
            seen.setdefault(channel.topic, (message, content))
        image, depth = seen["/front/image"][1], seen["/front/depth"][1]
        assert (image.encoding, image.width, image.height, image.step) == ("rgb8", 64, 48, 192)
        assert (depth.encoding, depth.step) == ("16UC1", 128)
        assert int.from_bytes(bytes(depth.data[:2]), "little") == 501
        info = seen["/front/camera_info"][1]
        assert list(info.k) == [60, 0, 31.5, 0, 61, 23.5, 0, 0, 1]
        assert list(info.d) == [0.1, -0.2, 0.001, 0.002, 0]
        imu = seen["/imu/imu"][1]
        assert imu.linear_acceleration.z == pytest.approx(9.81, abs=0.05)
        assert imu.orientation_covariance[0] == -1.0
        assert seen["/imu/temperature"][1].temperature == 25.0
        state, command = seen["/arm/joint_states"][1], seen["/arm/joint_commands"][1]
        assert state.name == [*(f"joint_{k}" for k in range(1, 8)), "gripper"]
        assert (state.position[7], state.effort[7]) == (0.04, 5.0)
        assert (command.position[0], command.position[7]) == (pytest.approx(1.001), 0.02)
        taxels = seen["/skin/taxels"][1]
        assert (taxels.encoding, taxels.height, taxels.width) == ("32FC1", 4, 6)

    def test_settings_and_calibration_lie_beside_and_inside(self, session: SessionRun) -> None:
        stored = (session.out / "calibration" / "front.yaml").read_bytes()
        with session.data.open("rb") as stream:
            reader = make_reader(stream)
            (metadata,) = [m for m in reader.iter_metadata() if m.name == "grasp_factory.session"]
            (file,) = reader.iter_attachments()
        assert (file.name, file.data) == ("calibration/front.yaml", stored)
        settings = json.loads(metadata.metadata["settings"])
        assert (settings["operator"], settings["tags"]) == ("me", ["wet"])
        assert "operator: me" in (session.out / "session.yaml").read_text()

    def test_info_says_what_is_there(self, session: SessionRun) -> None:
        facts = read_session(session.out)
        assert facts.is_complete
        by_topic = {topic.topic: topic for topic in facts.topics}
        assert by_topic["/wrist/wrench"].messages == session.record()["devices"]["wrist"]["written"]
        assert by_topic["/wrist/wrench"].lost == 0
        assert facts.events[0]["event"] == "session_started"
        assert facts.events[-1] | {"time_ns": 0} == {
            "event": "session_ended", "reason": "duration", "time_ns": 0,
        }  # fmt: skip

    def test_there_is_nothing_to_recover(self, session: SessionRun) -> None:
        found = recover(session.out)
        assert found.was_complete
        assert sorted(p.name for p in session.out.iterdir()) == [
            "calibration", "session.json", "session.mcap", "session.yaml",
        ]  # fmt: skip


@pytest.mark.parametrize(
    ("number", "code", "why"),
    [(signal.SIGINT, 0, "interrupted"), (signal.SIGTERM, 143, "terminated")],
)
def test_a_signal_ends_the_session_cleanly(
    number: signal.Signals, code: int, why: str, tmp_path: Path
) -> None:
    with recording(tmp_path, {"imu": IMU}) as run:
        run.until_recorded()
        assert run.stop(number) == code
    assert run.record()["ended"] == why
    assert events_of(run.data)[-1]["reason"] == why
    assert "Traceback" not in run.stderr


@pytest.mark.parametrize(("compression", "size"), [("none", 4_000_000), ("zstd", 400_000)])
def test_a_killed_recorder_loses_half_a_second_at_most(
    compression: str, size: int, tmp_path: Path
) -> None:
    devices = {"imu": IMU, "front": device(CAMERA, width=320, height=240)}
    with recording(tmp_path, devices, compression=compression) as run:
        run.until_recorded(size)
        killed_ns = time.time_ns()
        run.process.kill()
        run.wait()
    original = hashlib.sha256(run.data.read_bytes()).digest()
    with pytest.raises(McapError):  # readers refuse a file without its end
        list(decoded(run.data))
    found = recover(run.out)
    assert not found.was_complete
    recovered = run.out / "session.recovered.mcap"
    messages = list(decoded(recovered))
    assert len(messages) == found.messages
    assert compressions(recovered) == {compression.removeprefix("none")}
    times = [message.log_time for channel, message, _ in messages if channel.topic == "/imu/imu"]
    numbers = [message.sequence for channel, message, _ in messages if channel.topic == "/imu/imu"]
    assert numbers == list(range(len(numbers)))
    assert killed_ns - max(times) <= 500_000_000
    assert hashlib.sha256(run.data.read_bytes()).digest() == original
    record = run.record()
    assert (record["ended"], record["ended_cleanly"]) == ("killed", False)
    assert record["file"] == "session.recovered.mcap"
    assert record["devices"]["imu"]["written"] == len(numbers)
    with pytest.raises(CaptureError, match="was recovered before"):
        recover(run.out)


def test_a_session_that_is_recorded_can_be_looked_at_but_not_recovered(tmp_path: Path) -> None:
    with recording(tmp_path, {"imu": IMU}) as run:
        run.until_recorded()
        with pytest.raises(CaptureError, match="is being recorded"):
            recover(run.out)
        facts = read_session(run.out)
        assert not facts.is_complete
        assert facts.record is None
        assert {topic.topic for topic in facts.topics} >= {"/imu/imu", "/events"}
        assert run.stop() == 0


def test_a_full_disk_ends_in_one_line_and_what_is_written_stays(tmp_path: Path) -> None:
    """The limit on the size of a file stands in for a disk: writes come short, then fail."""
    with recording(tmp_path, {"front": device(CAMERA, width=320, height=240), "imu": IMU}) as run:
        run.until(run.data.exists)
        resource.prlimit(run.process.pid, resource.RLIMIT_FSIZE, (8_000_001, 8_000_001))
        assert run.wait() == 1
    (line,) = [line for line in run.stderr.splitlines() if line.startswith("Error: ")]
    assert "the disk failed (File too large)" in line
    assert f"capture recover {run.out}" in line
    assert "Traceback" not in run.stderr
    record = run.record()
    assert (record["ended"], record["ended_cleanly"]) == ("disk_failed", False)
    assert record["devices"]["imu"]["written"] < record["devices"]["imu"]["samples"]
    with run.data.open("rb") as file:  # it was cut back to whole records
        scan = McapScan(file.fileno(), with_checksums=True)
        whole = sum(1 for _ in scan.messages())
        assert scan.end == scan.size > 1_000_000
    assert recover(run.out).messages == whole
    assert len(list(decoded(run.out / "session.recovered.mcap"))) == whole
    assert run.record()["ended"] == "disk_failed"
    stored = {topic.device: topic.messages for topic in read_session(run.out).topics}
    for name, counted in record["devices"].items():
        assert stored[name] == counted["written"]


def test_a_disk_that_is_nearly_full_ends_the_session_cleanly(tmp_path: Path) -> None:
    with recording(tmp_path, {"imu": IMU}, disk_reserve_mb=1e9) as run:
        assert run.wait() == 0
    assert run.record()["ended"] == "disk_full"
    assert run.record()["ended_cleanly"]
    assert "alarm (disk): " in run.stderr


def test_an_emergency_stop_ends_the_session_and_is_recorded(tmp_path: Path) -> None:
    with recording(tmp_path, {"arm": device(ARM, stop_at_s=0.5), "imu": IMU}) as run:
        assert run.wait() == 0
    assert run.record()["ended"] == "emergency_stop"
    said = {event["event"]: event for event in events_of(run.data)}
    assert said["emergency_stop"]["device"] == "arm"
    assert said["session_ended"]["reason"] == "emergency_stop"
    stamps = [m.log_time for c, m, _ in decoded(run.data) if c.topic == "/arm/joint_states"]
    assert said["emergency_stop"]["time_ns"] in stamps


def test_a_device_that_is_unplugged_is_opened_again(tmp_path: Path) -> None:
    with recording(tmp_path, {"imu": device(IMU, vanish_at_s=0.5), "wrist": WRENCH}) as run:
        run.until(lambda: "alarm (trouble): imu: the device is gone" in run.stderr)
        run.until(lambda: b'"device_back"' in run.data.read_bytes())
        assert run.stop() == 0
    record = run.record()
    assert record["devices"]["imu"]["reconnects"] >= 1
    assert record["devices"]["wrist"]["lost"] == 0
    names = [event["event"] for event in events_of(run.data)]
    assert names.index("device_lost") < names.index("device_back")
    assert "the cable was pulled out" in run.stderr


def test_a_bug_of_a_driver_does_not_end_the_other_devices(tmp_path: Path) -> None:
    with recording(tmp_path, {"imu": device(IMU, crash_at_s=0.3), "wrist": WRENCH}) as run:
        run.until(lambda: "ZeroDivisionError: a bug of the driver" in run.stderr)
        size = run.data.stat().st_size
        run.until_recorded(size + 20_000)
        assert run.stop() == 0


def test_a_device_that_is_not_there_is_an_error_before_anything_is_made(tmp_path: Path) -> None:
    with recording(tmp_path, {"wrist": WRENCH, "imu": device(IMU, absent=True)}) as run:
        assert run.wait() == 1
    assert run.stderr.endswith(
        "Error: device imu: there is no device at /dev/ticking; plug it in\n"
    )
    assert not run.out.exists()


def test_a_frozen_camera_a_jumping_clock_and_bad_packets_raise_alarms(tmp_path: Path) -> None:
    devices = {
        "front": device(CAMERA, freeze_at_s=0.5),
        "imu": device(IMU, jump_at_s=3.0),
        "wrist": device(WRENCH, bad_each=10, skip_each=50),
    }
    with recording(tmp_path, devices) as run:
        for text in (
            "alarm (frozen): front: the same image",
            "alarm (clock): imu: the device's clock jumped by",
            "alarm (checksum): wrist:",
            "alarm (lost): wrist:",
        ):
            run.until(lambda text=text: text in run.stderr)
        assert run.stop() == 0
    alarms = {(e["device"], e["kind"]) for e in events_of(run.data) if e["event"] == "alarm"}
    wanted = {("front", "frozen"), ("imu", "clock"), ("wrist", "checksum"), ("wrist", "lost")}
    assert alarms >= wanted
    lost = {topic.device: topic.lost for topic in read_session(run.out).topics}["wrist"]
    record = run.record()["devices"]["wrist"]
    # One that was damaged or lost after the last sample is counted by the driver alone.
    assert lost <= record["lost"] + record["bad_checksums"] <= lost + 1


def test_a_count_that_wraps_at_32_bits_is_no_loss(tmp_path: Path) -> None:
    first = 2**32 - 30
    with recording(tmp_path, {"wrist": device(WRENCH, first_sequence=first)}) as run:
        run.until_recorded()
        assert run.stop() == 0
    numbers = [m.sequence for c, m, _ in decoded(run.data) if c.topic == "/wrist/wrench"]
    assert numbers[:32] == [(first + k) % 2**32 for k in range(32)]
    assert [topic.lost for topic in read_session(run.out).topics] == [0, 0]


def test_the_hook_moves_the_robot_marks_episodes_and_ends_the_session(tmp_path: Path) -> None:
    script = tmp_path / "move.py"
    script.write_text(
        "import json, time\n"
        "print('moving', flush=True)\n"
        "print(json.dumps({'event': 'episode_start', 'time_ns': 5}), flush=True)\n"
        "time.sleep(0.5)\n"
        "print(json.dumps({'event': 'episode_end', 'success': True}), flush=True)\n"
    )
    with recording(tmp_path, {"imu": IMU}, hook=[sys.executable, str(script)]) as run:
        assert run.wait() == 0
    assert run.record()["ended"] == "hook"
    said = [event for event in events_of(run.data) if event["event"] != "alarm"]
    assert [event["event"] for event in said] == [
        "session_started", "hook_started", "hook_says", "episode_start", "episode_end",
        "hook_ended", "session_ended",
    ]  # fmt: skip
    assert said[4]["success"] is True
    assert said[3]["time_ns"] > 10**18
    assert said[5]["code"] == 0


def test_what_no_json_can_hold_in_a_hook_s_line_does_not_end_the_recording(tmp_path: Path) -> None:
    script = tmp_path / "move.py"
    lines = [
        '{"event": "large", "value": 1e999}',
        '{"event": "half", "text": "\\ud800"}',
        '{"event": "deep", "value": ' + "[" * 200 + "]" * 200 + "}",
        '{"event": "last"}',
    ]
    script.write_text(f"print({chr(10).join(lines)!r})\n")
    with recording(tmp_path, {"imu": IMU}, hook=[sys.executable, str(script)]) as run:
        assert run.wait() == 0
    said = {event["event"]: event for event in events_of(run.data)}
    assert said["large"]["value"] is None
    assert "session_ended" in said
    assert {"half", "deep"}.isdisjoint(said)
    texts = [e["text"] for e in events_of(run.data) if e["event"] == "hook_says"]
    assert texts == lines[1:3]


def test_the_hook_is_stopped_with_the_session(tmp_path: Path) -> None:
    script = tmp_path / "move.py"
    script.write_text(
        "import signal, sys, time\n"
        "try:\n    print('up', flush=True)\n    time.sleep(100)\n"
        "except KeyboardInterrupt:\n    print('stopped', flush=True)\n    sys.exit(3)\n"
    )
    with recording(tmp_path, {"imu": IMU}, hook=[sys.executable, str(script)]) as run:
        run.until(lambda: b'"up"' in run.data.read_bytes())
        assert run.stop() == 0
    said = events_of(run.data)
    assert [event["text"] for event in said if event["event"] == "hook_says"] == ["up", "stopped"]
    assert [event["code"] for event in said if event["event"] == "hook_ended"] == [3]


def test_a_hook_that_is_not_there_is_one_line(tmp_path: Path) -> None:
    with recording(tmp_path, {"imu": IMU}, hook=["/no/such/program"]) as run:
        assert run.wait() == 1
    assert "Error: the hook '/no/such/program' cannot run: No such file" in run.stderr
