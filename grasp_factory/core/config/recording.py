"""Limits of what a config and a recipe record: cameras, the size of images, and rates."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Protocol

from grasp_factory.core.config.cameras import CameraConfig
from grasp_factory.core.config.physics import PhysicsConfig
from grasp_factory.core.config.within import Within
from grasp_factory.core.serialization import check

MOST_CAMERAS = 32
RECORD_HZ = Within(10, 10_000, "Hz")  # labels are read from the records
IMU_HZ = Within(1, 10_000, "Hz")
VIDEO_HZ = Within(0, 240, "Hz")
SIDES = "16 to 4096 pixels a side"
LONGEST_NAME = 64
"""Bytes of a name in UTF-8."""


class Recording(Protocol):
    """A config or a recipe."""

    @property
    def cameras(self) -> Mapping[str, CameraConfig]:
        """Cameras by name."""

    @property
    def resolution(self) -> tuple[int, int]:
        """Image width and height, pixels."""

    @property
    def video_hz(self) -> int:
        """Frames per second of the video; 0 for none."""

    @property
    def record_hz(self) -> int:
        """Rate of the streams."""

    @property
    def imu_hz(self) -> int:
        """Rate of the IMU."""

    @property
    def physics(self) -> PhysicsConfig:
        """Rates of the simulation steps."""


def check_recording(record: Recording) -> None:
    """Check the cameras, the size of their images, and the rates.

    Raises:
        ConfigError: naming the first value that is out of its range.
    """
    count = len(record.cameras)
    check(1 <= count <= MOST_CAMERAS, "cameras", count, f"1 to {MOST_CAMERAS} cameras")
    for name in record.cameras:
        check(name.isidentifier(), "cameras", name, "names of letters, digits and _")
        check_name("cameras", name)
    sides = [16 <= side <= 4096 for side in record.resolution]
    check(all(sides), "resolution", list(record.resolution), SIDES)
    RECORD_HZ.check("record_hz", record.record_hz)
    IMU_HZ.check("imu_hz", record.imu_hz)
    VIDEO_HZ.check("video_hz", record.video_hz)
    check_divides(record.physics, "record_hz", record.record_hz)
    if record.video_hz:
        check_divides(record.physics, "video_hz", record.video_hz)


def check_name(key: str, name: str) -> None:
    """Check a name that becomes the name of a folder in a store.

    Raises:
        ConfigError: if it is no word, or too long.
    """
    ok = re.fullmatch(r"\w+", name) is not None and len(name.encode()) <= LONGEST_NAME
    check(ok, key, name, f"names of letters, digits and _, up to {LONGEST_NAME} bytes")


def check_divides(physics: PhysicsConfig, key: str, got: int) -> None:
    """Check that a rate divides both rates of the physics engine.

    Raises:
        ConfigError: if it does not.
    """
    for name in ("free_hz", "contact_hz"):
        rate = getattr(physics, name)
        check(rate % got == 0, key, got, f"a divisor of physics.{name} ({rate})")
