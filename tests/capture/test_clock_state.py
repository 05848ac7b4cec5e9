"""What the kernel says of the system's clock is in a session."""

from __future__ import annotations

import ctypes
import json
import struct
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from support.session_run import IMU
from support.ticking_devices import registered

from grasp_factory.capture.session.clock_state import ClockState, clock_state
from grasp_factory.capture.session.recorder import SessionRecorder
from grasp_factory.capture.session.session_config import SessionConfig, device_models
from grasp_factory.core.serialization import from_plain

KEPT = ClockState(is_synchronised=True, offset_s=-0.25, estimated_error_s=0.5, largest_error_s=2.0)
NOT_KEPT = ClockState(
    is_synchronised=False, offset_s=0.0, estimated_error_s=16.0, largest_error_s=16.0
)


def kernel(result: int, *fields: int) -> Callable[[Any], Any]:
    def ntp_adjtime(data: Any) -> int:
        assert not any(data.raw)  # it sets nothing
        struct.pack_into("@Illlli", data, 0, 0, *fields)
        return result

    return lambda name: SimpleNamespace(ntp_adjtime=ntp_adjtime)


@pytest.mark.parametrize(
    ("library", "found"),
    [
        (kernel(0, -250_000_000, 7, 2_000_000, 500_000, 0x2001), KEPT),
        (kernel(5, 0, 0, 16_000_000, 16_000_000, 0x40), NOT_KEPT),
        (kernel(-1, 0, 0, 0, 0, 0), None),
        (lambda name: SimpleNamespace(), None),
    ],
    ids=["kept by PTP", "not kept", "an error", "no such call"],
)
def test_the_fields_of_the_kernel_are_read(
    library: Any, found: ClockState | None, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(ctypes, "CDLL", library)
    assert clock_state() == found


def test_a_session_says_what_the_kernel_says_of_its_clock(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, run: Callable[..., tuple[int, str, str]]
) -> None:
    monkeypatch.setattr(ctypes, "CDLL", kernel(0, -250_000_000, 7, 2_000_000, 500_000, 0x2001))
    config = from_plain(SessionConfig, {"devices": {"imu": IMU}})
    with registered():
        models = device_models(config)
    with SessionRecorder(config, models, tmp_path / "s", {}, print) as recorder:
        recorder.wait(0.1)
    assert recorder.record is not None
    assert recorder.record.clock == KEPT
    record = tmp_path / "s" / "session.json"
    told = json.loads(record.read_text()) | {"ended": "Ctrl-C\n0 alarms"}
    record.write_text(json.dumps(told))
    code, said, _ = run("capture", "info", tmp_path / "s")
    assert code == 0
    assert said.splitlines()[0].endswith(r"ended by Ctrl-C\n0 alarms")
    kept = (
        "the clock of this machine was kept by PTP or NTP, within 500.000 ms, at most 2000.000 ms"
    )
    assert kept in said.splitlines()
