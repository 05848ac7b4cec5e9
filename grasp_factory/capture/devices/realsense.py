"""Driver of Intel RealSense cameras, by librealsense: colour and depth of one instant.

https://github.com/IntelRealSense/librealsense. The wheel needs the system's libusb-1.0.
"""

# ruff: noqa: PLC0415

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import dataclass
from threading import Event
from typing import Any

import numpy as np

from grasp_factory.capture.devices.base import DeviceCounters, DeviceModel
from grasp_factory.capture.devices.reconnection import reconnect
from grasp_factory.capture.devices.serial_device import LONGEST_WAIT_S
from grasp_factory.capture.samples import CameraFrame, DeviceKind, Sample
from grasp_factory.core.serialization import check, check_range, normalise
from grasp_factory.errors import CaptureError, shown

SOFTWARE_DEVICES: dict[str, Any] = {}
"""librealsense's ``software_device`` by serial number: cameras that are not on USB."""
_POLL_MS = 50
_WAITING_FRAMES = 64
"""Sets of frames that wait until they are read; librealsense drops more."""
_SILENT_S = 0.3
"""After so long without a frame, the driver looks whether the camera is still there."""
_LONGEST_MM = 2**16 - 1


@dataclass(frozen=True, slots=True, kw_only=True)
class RealSenseSettings:
    """The settings of the driver ``realsense``."""

    serial: str = ""
    """Serial number of the camera; empty for the only one that is plugged in."""
    width: int = 640
    """Pixels, of colour and depth."""
    height: int = 480
    fps: int = 30
    """Frames per second, of colour and depth."""
    align: bool = True
    """Whether depth is moved into the colour camera's view. False if it is there already."""
    reconnect_s: float = 10.0
    """How long a camera that went away is waited for."""

    def __post_init__(self) -> None:
        normalise(self)
        is_number = len(self.serial) <= 64 and self.serial.isprintable()
        check(is_number, "serial", self.serial, "up to 64 characters")
        check_range(self, "width", 1, 16_384)
        check_range(self, "height", 1, 16_384)
        check_range(self, "fps", 1, 1000, "Hz")
        check_range(self, "reconnect_s", 0.0, LONGEST_WAIT_S, "s")


class RealSenseCamera:
    """The driver. The device time is that of the camera's own clock, if librealsense has it."""

    def __init__(self, settings: RealSenseSettings) -> None:
        self.counters = DeviceCounters()
        self._settings, self._stopped = settings, Event()
        self._device: Any = None
        self._sensors: list[Any] = []
        self._syncer: Any = None
        self._mm_per_count = 1.0
        self._is_software = False

    def open(self) -> None:
        """See ``Device.open``."""
        self._stopped.clear()
        self.counters = DeviceCounters()
        self._connect()

    def samples(self) -> Iterator[Sample[CameraFrame]]:
        """See ``Device.samples``; a colour image whose depth did not come has none.

        librealsense pairs streams after it has seen both: what comes before is left out.
        """
        while not self._stopped.is_set():
            try:
                yield from self._frames()
            except CaptureError as lost:
                self.close()
                if reconnect(self._connect, self._stopped, self._settings.reconnect_s, lost):
                    self.counters.reconnects += 1

    def stop(self) -> None:
        """See ``Device.stop``."""
        self._stopped.set()

    def close(self) -> None:
        """See ``Device.close``."""
        sensors, self._sensors, self._syncer, self._device = self._sensors, [], None, None
        for sensor in sensors:
            for leave in (sensor.stop, sensor.close):
                try:
                    leave()
                except RuntimeError:  # it was unplugged, or had not started
                    continue

    def _frames(self) -> Iterator[Sample[CameraFrame]]:
        import pyrealsense2 as rs

        align = rs.align(rs.stream.color) if self._settings.align else None
        heard, last, has_pairs = time.monotonic(), None, False
        while not self._stopped.is_set():
            is_there, frames = self._syncer.try_wait_for_frames(_POLL_MS)
            now = time.monotonic_ns()
            colour = frames.get_color_frame() if is_there else None
            if not colour:
                if time.monotonic() - heard > _SILENT_S and not self._is_connected():
                    raise CaptureError(f"{self._name} is lost")
                continue
            heard, number = time.monotonic(), int(colour.get_frame_number())
            has_pairs = has_pairs or bool(frames.get_depth_frame())
            if not has_pairs:
                continue
            if last is not None and number > last + 1:
                self.counters.lost += number - last - 1
            last = number
            self.counters.samples += 1
            own = colour.get_frame_timestamp_domain() == rs.timestamp_domain.hardware_clock
            if align and frames.get_depth_frame():
                frames = align.process(frames)
            yield Sample(
                device_ns=round(colour.get_timestamp() * 1e6) if own else None,
                host_ns=now,
                sequence=number,
                payload=CameraFrame(rgb=np.array(colour.get_data()), depth=self._depth(frames)),
            )

    def _depth(self, frames: Any) -> Any:
        depth = frames.get_depth_frame()
        if not depth:
            return None
        millimetres = np.rint(np.asarray(depth.get_data(), np.float64) * self._mm_per_count)
        return np.where(millimetres <= _LONGEST_MM, millimetres, 0).astype(np.uint16)

    def _connect(self) -> None:
        import pyrealsense2 as rs

        try:
            self._device = self._found(rs)
            chosen = [
                self._stream(rs.stream.depth, rs.format.z16),
                self._stream(rs.stream.color, rs.format.rgb8),
            ]
            units = chosen[0][0].get_option(rs.option.depth_units)
            self._mm_per_count = round(units * 1e3, 6)
            self._syncer = rs.syncer(_WAITING_FRAMES)
            for sensor, profile in chosen:
                if sensor.supports(rs.option.global_time_enabled):
                    sensor.set_option(rs.option.global_time_enabled, 0.0)
                self._sensors.append(sensor)
                sensor.open(profile)
                sensor.start(self._syncer)
        except (RuntimeError, CaptureError) as error:
            self.close()
            if isinstance(error, CaptureError):
                raise
            raise CaptureError(f"{self._name}: {shown(str(error))}") from None

    @property
    def _name(self) -> str:
        return f"RealSense camera {shown(self._settings.serial)}".strip()

    def _found(self, rs: Any) -> Any:
        plugged = rs.context().query_devices()
        by_serial = {each.get_info(rs.camera_info.serial_number): each for each in plugged}
        by_serial |= SOFTWARE_DEVICES
        chosen = self._settings.serial or (next(iter(by_serial)) if len(by_serial) == 1 else "")
        if chosen not in by_serial:
            valid = ", ".join(map(shown, by_serial)) or "none is plugged in"
            raise CaptureError(f"{self._name} is not there; set serial, valid: {valid}")
        self._is_software = chosen in SOFTWARE_DEVICES
        return by_serial[chosen]

    def _is_connected(self) -> bool:
        if not self._is_software:
            return bool(self._device.is_connected())
        return any(self._device is each for each in SOFTWARE_DEVICES.values())

    def _stream(self, stream: Any, pixels: Any) -> tuple[Any, Any]:
        """Return the sensor and the profile of a stream in the size and rate of the settings."""
        settings, sizes = self._settings, set[str]()
        for sensor in self._device.query_sensors():
            for profile in sensor.get_stream_profiles():
                if profile.stream_type() != stream or profile.format() != pixels:
                    continue
                video = profile.as_video_stream_profile()
                size = video.width(), video.height(), video.fps()
                if size == (settings.width, settings.height, settings.fps):
                    return sensor, profile
                sizes.add("{}x{} at {} Hz".format(*size))
        wanted = f"{settings.width}x{settings.height} at {settings.fps} Hz"
        valid = ", ".join(sorted(sizes)) or "none"
        raise CaptureError(f"{self._name} has no {stream.name} of {wanted}, valid: {valid}")


REALSENSE_MODEL = DeviceModel(
    name="realsense",
    kind=DeviceKind.CAMERA,
    description="Intel RealSense camera, colour and depth",
    settings=RealSenseSettings,
    implementation="grasp_factory.capture.devices.realsense:RealSenseCamera",
    simulator="grasp_factory.capture.simulators.realsense:SimulatedRealSense",
    modules=("pyrealsense2",),
    extra="realsense",
)
