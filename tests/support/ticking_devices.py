"""Devices that make samples by the clock, with faults on request, for tests of the recorder.

``registered`` puts them into the table of devices; as a program, this file runs the command with
them: ``python -m support.ticking_devices capture run session.yaml``.
"""

from __future__ import annotations

import sys
import threading
import time
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, Self
from unittest.mock import patch

import numpy as np

from grasp_factory.capture.devices import DEVICES
from grasp_factory.capture.devices.base import DeviceCounters, DeviceModel
from grasp_factory.capture.samples import (
    CameraFrame,
    DeviceKind,
    InertialReading,
    JointReading,
    Payload,
    Sample,
    TactileReading,
    WrenchReading,
)
from grasp_factory.core.episode import Episode
from grasp_factory.errors import CaptureError


@dataclass(frozen=True, slots=True, kw_only=True)
class TickingSettings:
    """Times are seconds after the device was opened; a negative one never comes."""

    rate_hz: float = 100.0
    width: int = 64
    height: int = 48
    with_depth: bool = False
    first_sequence: int = 0
    own_clock_ns: int | None = 1_000_000_000
    """The device's time when it is opened; None without a clock."""
    absent: bool = False
    freeze_at_s: float = -1.0
    vanish_at_s: float = -1.0
    """It is gone, and comes back when it is opened again."""
    jump_at_s: float = -1.0
    jump_ns: int = 500_000_000
    stop_at_s: float = -1.0
    """An emergency stop."""
    end_at_s: float = -1.0
    crash_at_s: float = -1.0
    bad_each: int = 0
    """Every so many packets, one is damaged."""
    skip_each: int = 0
    """Every so many samples, one is lost on the way."""


def after(at_s: float, now_s: float) -> bool:
    return 0.0 <= at_s <= now_s


class TickingDevice:
    """A device of any kind."""

    kind = DeviceKind.IMU

    def __init__(self, settings: TickingSettings) -> None:
        self.counters = DeviceCounters()
        self._settings = settings
        self._over = threading.Event()
        self._rng = np.random.default_rng(0)
        self._noise = self._rng.integers(0, 255, (97, settings.width * 3), np.uint8)

    def open(self) -> None:
        if self._settings.absent:
            raise CaptureError("there is no device at /dev/ticking; plug it in")

    def samples(self) -> Iterator[Sample[Payload]]:
        settings = self._settings
        start, place = time.monotonic_ns(), -1
        while not self._over.is_set():
            place += 1
            now_s = place / settings.rate_hz
            due = start + round(1e9 * now_s)
            ahead = (due - time.monotonic_ns()) / 1e9
            if ahead > 0.0 and self._over.wait(ahead):
                return
            if after(settings.end_at_s, now_s):
                return
            if after(settings.vanish_at_s, now_s):
                raise CaptureError("the cable was pulled out")
            if after(settings.crash_at_s, now_s):
                raise ZeroDivisionError("a bug of the driver")
            if settings.skip_each and place % settings.skip_each == settings.skip_each - 1:
                self.counters.lost += 1
                continue
            if settings.bad_each and place % settings.bad_each == settings.bad_each - 1:
                self.counters.bad_checksums += 1
                continue
            self.counters.samples += 1
            yield Sample(
                device_ns=self._device_ns(now_s),
                host_ns=time.monotonic_ns(),
                sequence=settings.first_sequence + place,
                payload=self._payload(
                    0 if after(settings.freeze_at_s, now_s) else place + 1, now_s
                ),
            )

    def _device_ns(self, now_s: float) -> int | None:
        if self._settings.own_clock_ns is None:
            return None
        jump = self._settings.jump_ns if after(self._settings.jump_at_s, now_s) else 0
        return self._settings.own_clock_ns + round(1e9 * now_s) + jump

    def _payload(self, place: int, now_s: float) -> Payload:
        raise NotImplementedError

    def stop(self) -> None:
        self._over.set()

    def close(self) -> None:
        self._over.set()


class TickingCamera(TickingDevice):
    kind = DeviceKind.CAMERA

    def _payload(self, place: int, now_s: float) -> Payload:
        settings = self._settings
        rows = np.arange(settings.height) + place
        rgb = self._noise[rows % 97].reshape(settings.height, settings.width, 3)
        depth = None
        if settings.with_depth:
            depth = np.full((settings.height, settings.width), 500 + place % 100, np.uint16)
        return CameraFrame(rgb=rgb, depth=depth)


class TickingImu(TickingDevice):
    def _payload(self, place: int, now_s: float) -> Payload:
        wave = np.sin(place * np.array([0.01, 0.02, 0.03]))
        return InertialReading(
            specific_force=wave + np.array([0.0, 0.0, 9.81]),
            angular_velocity=0.1 * wave,
            temperature=25.0,
        )


class TickingWrench(TickingDevice):
    kind = DeviceKind.FORCE_TORQUE

    def _payload(self, place: int, now_s: float) -> Payload:
        return WrenchReading(wrench=np.sin(place * np.linspace(0.001, 0.006, 6)))


class TickingTaxels(TickingDevice):
    kind = DeviceKind.TACTILE

    def _payload(self, place: int, now_s: float) -> Payload:
        return TactileReading(pressure=np.full((4, 6), float(place % 10)))


class TickingArm(TickingDevice):
    kind = DeviceKind.JOINTS

    def _payload(self, place: int, now_s: float) -> Payload:
        angles = 0.001 * place + np.zeros(7)
        return JointReading(
            positions=angles,
            velocities=angles,
            torques=angles,
            position_targets=angles + 1.0,
            gripper_width=0.04,
            gripper_width_target=0.02,
            gripper_force=5.0,
            is_stopped=after(self._settings.stop_at_s, now_s),
        )


class PlayedTicking:
    """A simulator: the device of the same settings is there while it is in ``with``."""

    def __init__(self, episode: Episode) -> None:
        self.times = episode.streams["timestamp"]
        self.is_playing = False

    @property
    def settings(self) -> dict[str, Any]:
        return {"rate_hz": 50.0}

    def play(self) -> None:
        self.is_playing = True

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.is_playing = False


CLASSES: dict[str, type[TickingDevice]] = {
    "ticking_camera": TickingCamera,
    "ticking_imu": TickingImu,
    "ticking_wrench": TickingWrench,
    "ticking_taxels": TickingTaxels,
    "ticking_arm": TickingArm,
}


def models() -> dict[str, DeviceModel]:
    """Return the rows of the table."""
    return {
        name: DeviceModel(
            name=name,
            kind=cls.kind,
            description="a device of a test",
            settings=TickingSettings,
            implementation=f"support.ticking_devices:{cls.__name__}",
            simulator="support.ticking_devices:PlayedTicking",
        )
        for name, cls in CLASSES.items()
    }


def registered() -> Any:
    """Return a context in which the devices are in the table of this process."""
    return patch.dict(DEVICES, models())


if __name__ == "__main__":
    from grasp_factory.__main__ import main

    sys.argv[0] = "grasp-factory"
    with registered():
        main()
