"""Recordings as devices: files of anybody, which a process with limits reads."""

from __future__ import annotations

from pathlib import Path

import pytest
from support.devices import played, simulator

from grasp_factory.capture.devices import DEVICES
from grasp_factory.errors import CaptureError


@pytest.mark.parametrize("name", ["opencv", "rosbag_imu"])
def test_a_recording_is_read_in_another_process(name: str, isolated: None) -> None:
    simulated = simulator(DEVICES[name], speed=8.0)
    run = played(DEVICES[name], simulated)
    assert run.error is None
    assert len(run.samples) == len(simulated.sent)


@pytest.mark.parametrize("content", [b"", b"\x89MCAP0\r\n" + bytes(200), b"#ROSBAG V2.0\n" * 9])
def test_a_damaged_file_is_an_error_in_one_line(content: bytes, tmp_path: Path) -> None:
    file = tmp_path / "recording"
    file.write_bytes(content)
    for name, settings in (
        ("opencv", {"source": str(file)}),
        ("rosbag_imu", {"path": str(file), "topic": "/imu"}),
    ):
        device = DEVICES[name].make(settings)
        with pytest.raises(CaptureError) as refused:
            device.open()  # FFmpeg takes zeros for a first frame
            list(device.samples())
        assert "\n" not in str(refused.value)
        device.close()
