"""How much the recorder takes: sensors of a usual robot, for some minutes.

    PYTHONPATH=tests python -m benchmarks.bench_capture [--seconds 600] [--keep-gb 4] [--folder DIR]

Two cameras of 640 x 480 at 30 Hz, one with depth, an IMU at 400 Hz, a force-torque sensor at
1 kHz, and joints at 500 Hz. The devices are made by the clock in this process, so that their time
counts too. Prints samples, losses, processor time and MB/s; fails if a sample is not accounted for.

Ten minutes are 45 GB. They are all written to the disk. Another process reads them behind the
recorder, with checksums, counts the messages, and frees all but the latest ``--keep-gb``. Its
processor time is told apart, but it needs the same cores: the recorder has less of them.
"""

from __future__ import annotations

import argparse
import resource
import shutil
import tempfile
from pathlib import Path
from typing import Any

from benchmarks.following import Follower
from support.ticking_devices import registered

from grasp_factory.capture.session.recorder import SessionRecorder
from grasp_factory.capture.session.session_config import SessionConfig, device_models
from grasp_factory.core.serialization import from_plain

CAMERA = {"width": 640, "height": 480, "rate_hz": 30}


def devices() -> dict[str, Any]:
    """Return the devices of the session."""
    rates = {"imu": 400, "wrench": 1000, "arm": 500}
    fast = {
        name: {"driver": f"ticking_{name}", "rate_hz": rate, "settings": {"rate_hz": rate}}
        for name, rate in rates.items()
    }
    cameras = {
        name: {"driver": "ticking_camera", "rate_hz": 30, "settings": CAMERA | more}
        for name, more in {"front": {"with_depth": True}, "wrist_camera": {}}.items()
    }
    return cameras | fast


def used() -> float:
    """Return the processor time of this process, s."""
    found = resource.getrusage(resource.RUSAGE_SELF)
    return found.ru_utime + found.ru_stime


def main() -> None:
    """Measure."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=600.0)
    parser.add_argument("--folder", type=Path, default=None, help="on the disk to be measured")
    parser.add_argument("--keep-gb", type=float, default=4.0, help="of the file that stay there")
    parser.add_argument("--compression", choices=("none", "zstd"), default="none")
    options = parser.parse_args()
    plain = {
        "devices": devices(),
        "duration_s": options.seconds,
        "disk_reserve_mb": 100,
        "compression": options.compression,
    }
    config = from_plain(SessionConfig, plain)
    folder = Path(tempfile.mkdtemp(prefix="bench_capture_", dir=options.folder))
    try:
        follower = Follower(folder / "session/session.mcap", round(1e9 * options.keep_gb))
        with registered(), follower:
            measure(config, folder / "session", options.seconds, follower)
    finally:
        shutil.rmtree(folder)


def measure(config: SessionConfig, out: Path, seconds: float, follower: Follower) -> None:
    """Record a session and print what it took."""
    before = used()
    with SessionRecorder(config, device_models(config), out, {}, print) as recorder:
        while not recorder.wait(1.0):
            pass
    processor, record = used() - before, recorder.record
    assert record is not None
    follower.finish()
    assert not follower.trouble, follower.trouble
    for name, device in record.devices.items():
        expected = round((config.devices[name].rate_hz or 0.0) * seconds)
        stored = {count for (owner, _), count in follower.messages.items() if owner == name}
        print(
            f"{name}: {device.samples} samples of {expected}, {device.written} written,"
            f" {device.dropped} dropped, {device.lost} lost by the device's count, longest gap"
            f" {1e3 * device.longest_gap_s:.1f} ms"
        )
        assert device.samples == device.written + device.dropped + device.unwritable
        assert stored == {device.written}, (name, stored)
    print(
        f"{record.bytes / 1e6 / seconds:.1f} MB/s, {record.bytes / 1e9:.1f} GB written and read"
        f" again, {processor / seconds:.2f} cores and {follower.cores_s / seconds:.2f} of the"
        f" reader, {resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e3:.0f} MB of memory"
    )


if __name__ == "__main__":
    main()
