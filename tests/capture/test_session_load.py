"""A recorder in this process: a slow disk, odd payloads, and a demo without hardware."""

from __future__ import annotations

import os
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from support.faulty_disk import FaultyDisk
from support.places import TINY
from support.session_run import IMU, WRENCH
from support.ticking_devices import TickingImu, registered

from grasp_factory.capture.samples import InertialReading, Payload
from grasp_factory.capture.session.recorder import SessionRecorder
from grasp_factory.capture.session.session_config import SessionConfig, device_models
from grasp_factory.capture.session.session_reading import dropped_samples, read_session
from grasp_factory.core.serialization import from_plain
from grasp_factory.errors import CaptureError, UsageError


@pytest.fixture(scope="module", autouse=True)
def devices() -> Iterator[None]:
    with registered():
        yield


class Session:
    """A session of some devices, and what it told."""

    def __init__(self, out: Path, devices: dict[str, Any], **plain: Any) -> None:
        self.config = from_plain(SessionConfig, {"devices": devices, **plain})
        self.out = out
        self.said: list[str] = []

    def recorder(self) -> SessionRecorder:
        models = device_models(self.config)
        return SessionRecorder(self.config, models, self.out, {}, self.said.append)


def until(condition: Callable[[], Any]) -> None:
    deadline = time.monotonic() + 60.0
    while not condition():
        assert time.monotonic() < deadline
        time.sleep(0.01)


def test_a_disk_that_does_not_keep_up_drops_samples_and_counts_them_exactly(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    real, is_slow = os.pwrite, threading.Event()

    def slow(*args: Any) -> int:
        if is_slow.is_set():
            time.sleep(0.3)
        return real(*args)

    monkeypatch.setattr(os, "pwrite", slow)
    session = Session(tmp_path / "s", {"wrist": WRENCH, "imu": IMU}, queue_s=0.1)
    with session.recorder() as recorder:
        is_slow.set()
        until(lambda: any("alarm (drop)" in line for line in session.said))
        is_slow.clear()
        recorder.wait(0.5)
    assert recorder.record is not None
    facts = read_session(session.out)
    stored = {topic.device: topic for topic in facts.topics}
    for name, counted in recorder.record.devices.items():
        assert counted.samples == counted.written + counted.dropped
        assert stored[name].messages == counted.written
    wrist = recorder.record.devices["wrist"]
    assert wrist.dropped > 0
    assert stored["wrist"].lost in range(wrist.dropped - 60, wrist.dropped + 1)
    events = [event for event in facts.events if event["event"] == "samples_dropped"]
    assert sum(event["count"] for event in events if event["device"] == "wrist") == wrist.dropped
    assert dropped_samples(facts)["wrist"] == wrist.dropped
    assert "the disk or the processor is too slow" in " ".join(session.said)


@pytest.mark.soak
def test_a_slow_fsync_does_not_hold_up_the_writer(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    real, may_end = os.fsync, threading.Event()

    def slow(descriptor: int) -> None:
        may_end.wait(60.0)
        real(descriptor)

    session = Session(tmp_path / "s", {"wrist": WRENCH}, queue_s=0.1)
    with session.recorder() as recorder:
        monkeypatch.setattr(os, "fsync", slow)
        until(lambda: any("the disk has been busy" in line for line in session.said))
        may_end.set()
    assert recorder.record is not None
    assert recorder.record.devices["wrist"].dropped == 0
    assert recorder.record.ended_cleanly


@pytest.mark.parametrize("call", ["pwrite", "fsync"])
def test_a_disk_that_fails_is_one_line_and_the_rest_is_counted(call: str, tmp_path: Path) -> None:
    session = Session(tmp_path / "s", {"wrist": WRENCH})
    later = time.monotonic() + 1.5

    def is_first(what: str) -> bool:
        return what == f"{call} s/session.mcap" and time.monotonic() > later

    disk = FaultyDisk(tmp_path, is_first, 28, stays=True)
    with (
        disk.installed(),
        pytest.raises(CaptureError, match="the disk failed \\(No space left on device\\)"),
        session.recorder() as recorder,
    ):
        until(lambda: recorder.wait(0.1))
        recorder.end("stopped")
    assert disk.has_failed
    assert recorder.why == "disk_failed"
    assert recorder.record is not None
    assert not recorder.record.ended_cleanly
    wrist = recorder.record.devices["wrist"]
    assert 0 < wrist.written < wrist.samples
    assert read_session(session.out).topics[-1].messages == wrist.written


def test_a_sample_that_no_message_can_hold_is_counted_and_told(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def odd(self: Any, place: int, now_s: float) -> Payload:
        force = np.zeros(3 if place % 2 else 2)
        return InertialReading(specific_force=force, angular_velocity=np.zeros(3))

    monkeypatch.setattr(TickingImu, "_payload", odd)
    session = Session(tmp_path / "s", {"imu": IMU})
    with session.recorder() as recorder:
        until(lambda: any("samples cannot be stored" in line for line in session.said))
    assert recorder.record is not None
    imu = recorder.record.devices["imu"]
    assert imu.unwritable > 0
    assert imu.samples == imu.written + imu.unwritable + imu.dropped


def test_a_folder_that_exists_is_not_touched(tmp_path: Path) -> None:
    (tmp_path / "s").mkdir()
    session = Session(tmp_path / "s", {"imu": IMU})
    with pytest.raises(UsageError, match="overwrites nothing"), session.recorder():
        pass
    assert list((tmp_path / "s").iterdir()) == []


@pytest.mark.soak
def test_a_demo_plays_an_episode_into_a_session(
    tmp_path: Path, run: Callable[..., tuple[int, str, str]]
) -> None:
    out = tmp_path / "demo"
    code, said, err = run("capture", "demo", TINY, "--row", 1, "--out", out)
    assert code == 0, err
    assert "ended by duration" in said
    facts = read_session(out)
    aside = ("alarm", "device_ended")  # a camera that plays a file ends with it
    names = [event["event"] for event in facts.events if event["event"] not in aside]
    assert names == ["session_started", "episode_start", "episode_end", "session_ended"]
    assert {topic.device for topic in facts.topics} >= {"front", "imu", "wrist", "arm"}
    code, said, _ = run("capture", "info", out)
    assert (code, "/imu/imu" in said) == (0, True)
    code, said, _ = run("capture", "recover", out)
    assert (code, "nothing to recover" in said) == (0, True)
