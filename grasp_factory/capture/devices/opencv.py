"""Driver of cameras and video files that OpenCV reads.

A file is decoded in a process with limits, for it may be anybody's. Its device time is the time in
the file. A camera has the time of its driver, if OpenCV knows it.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from threading import Event
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from grasp_factory.capture.devices.base import DeviceCounters, DeviceModel
from grasp_factory.capture.devices.pacing import Pacer
from grasp_factory.capture.devices.reconnection import reconnect
from grasp_factory.capture.devices.serial_device import LONGEST_WAIT_S
from grasp_factory.capture.samples import CameraFrame, DeviceKind, Sample
from grasp_factory.capture.transport.task_stream import TaskStream, limited_stream
from grasp_factory.core.executors import SendMessage
from grasp_factory.core.serialization import check, check_range, normalise
from grasp_factory.errors import CaptureError

MOST_SIDE = 16_384
"""Pixels."""
_OPENING_S = 30.0
"""How long the first frame is waited for; a process must start."""
_LEAVING_S = 0.1
_MS = 1e6
"""Nanoseconds."""
TimedFrame = tuple[int | None, int, NDArray[np.uint8]]
"""Device time and host time, ns, and the image, RGB."""


@dataclass(frozen=True, slots=True, kw_only=True)
class OpenCvSettings:
    """The settings of the driver ``opencv``."""

    source: str
    """Number of a V4L2 camera, such as 0 for /dev/video0, or the path of a video file."""
    width: int = 0
    """Pixels that the camera is asked for; 0 for its own choice."""
    height: int = 0
    """Pixels that the camera is asked for; 0 for its own choice."""
    fps: float = 0.0
    """Frames per second that the camera is asked for; 0 for its own choice."""
    speed: float = 1.0
    """How much faster than its own time a file is played; 0 for as fast as possible."""
    reconnect_s: float = 10.0
    """How long a camera that went away is waited for."""

    def __post_init__(self) -> None:
        normalise(self)
        is_name = 0 < len(self.source) <= 1000 and "\0" not in self.source
        check(is_name, "source", self.source, "a number, or the path of a video file")
        check_range(self, "width", 0, MOST_SIDE)
        check_range(self, "height", 0, MOST_SIDE)
        check_range(self, "fps", 0.0, 1000.0, "Hz")
        check_range(self, "speed", 0.0, 1000.0)
        check_range(self, "reconnect_s", 0.0, LONGEST_WAIT_S, "s")

    @property
    def is_camera(self) -> bool:
        """Whether the source is a camera."""
        return self.source.isascii() and self.source.isdecimal() and len(self.source) < 4


class OpenCvCamera:
    """The driver."""

    def __init__(self, settings: OpenCvSettings) -> None:
        self.counters = DeviceCounters()
        self._settings, self._stopped = settings, Event()
        self._stream: TaskStream | None = None
        self._first: list[TimedFrame] = []

    def open(self) -> None:
        """See ``Device.open``."""
        self._stopped.clear()
        self.counters = DeviceCounters()
        self._connect()

    def samples(self) -> Iterator[Sample[CameraFrame]]:
        """See ``Device.samples``."""
        pacer, is_camera = Pacer(self._settings.speed), self._settings.is_camera
        for device_ns, host_ns, image in self._frames():
            if not is_camera:
                pacer.wait(device_ns or 0, self._stopped)
            if self._stopped.is_set():
                return
            number = None if is_camera else self.counters.samples
            self.counters.samples += 1
            yield Sample(
                device_ns=device_ns,
                host_ns=host_ns if is_camera else time.monotonic_ns(),
                sequence=number,
                payload=CameraFrame(rgb=image),
            )

    def stop(self) -> None:
        """See ``Device.stop``."""
        self._stopped.set()

    def close(self) -> None:
        """See ``Device.close``."""
        stream, self._stream = self._stream, None
        if stream is not None:
            stream.close(_LEAVING_S if self._settings.is_camera else None)

    def _frames(self) -> Iterator[TimedFrame]:
        while self._stream is not None and not self._stopped.is_set():
            first, self._first = self._first, []
            try:
                yield from first
                yield from self._stream.items(self._stopped)
                return
            except CaptureError as lost:
                self.close()
                if not self._settings.is_camera:
                    raise
                limit = self._settings.reconnect_s
                if reconnect(self._connect, self._stopped, limit, lost):
                    self.counters.reconnects += 1

    def _connect(self) -> None:
        settings = self._settings
        if settings.is_camera:
            self._stream = TaskStream(partial(read_camera, settings))
        else:
            self._stream = limited_stream(read_file, settings.source, Path(settings.source))
        frame = self._stream.first(_OPENING_S)
        if frame is None:
            self.close()
            raise CaptureError(f"{settings.source} has no frame: {_VALID}")
        self._first = [frame]


_VALID = "valid: a camera's number that `ls /dev/video*` shows, or a video that OpenCV can read"


def read_camera(settings: OpenCvSettings, report: SendMessage) -> None:
    """Report the frames of a camera until it goes away.

    Raises:
        CaptureError: if it is not there, or goes away.
    """
    camera = cv2.VideoCapture(int(settings.source), cv2.CAP_V4L2)
    try:
        if not camera.isOpened():
            raise CaptureError(f"camera {settings.source} cannot be opened: {_VALID}")
        for key, value in (
            (cv2.CAP_PROP_FRAME_WIDTH, settings.width),
            (cv2.CAP_PROP_FRAME_HEIGHT, settings.height),
            (cv2.CAP_PROP_FPS, settings.fps),
        ):
            if value:
                camera.set(key, value)
        while True:
            is_there, image = camera.read()
            now = time.monotonic_ns()
            if not is_there:
                raise CaptureError(f"camera {settings.source} is lost")
            time_ms = camera.get(cv2.CAP_PROP_POS_MSEC)
            report((int(time_ms * _MS) if time_ms > 0.0 else None, now, rgb(image)))
    finally:
        camera.release()


def read_file(source: str, report: SendMessage) -> None:
    """Report the frames of a video file with their times in it.

    Raises:
        CaptureError: if it cannot be read, or ends before its last frame.
    """
    file = cv2.VideoCapture(source, cv2.CAP_FFMPEG)
    try:
        if not Path(source).is_file() or not file.isOpened():
            raise CaptureError(f"{source} cannot be read: {_VALID}")
        expected, found = int(file.get(cv2.CAP_PROP_FRAME_COUNT)), 0
        while file.grab():
            time_ns = round(file.get(cv2.CAP_PROP_POS_MSEC) * _MS)
            is_there, image = file.retrieve()
            if not is_there:
                break
            report((time_ns, 0, rgb(image)))
            found += 1
        if found < expected:
            raise CaptureError(f"{source}: {found} of {expected} frames can be read: it is damaged")
    finally:
        file.release()


def rgb(image: Any) -> NDArray[np.uint8]:
    """Return an image of OpenCV, BGR or grey, as RGB (H, W, 3)."""
    code = cv2.COLOR_GRAY2RGB if image.ndim == 2 else cv2.COLOR_BGR2RGB
    return np.asarray(cv2.cvtColor(image, code), np.uint8)


OPENCV_MODEL = DeviceModel(
    name="opencv",
    kind=DeviceKind.CAMERA,
    description="camera over V4L2, or a video file as a camera",
    settings=OpenCvSettings,
    implementation="grasp_factory.capture.devices.opencv:OpenCvCamera",
    simulator="grasp_factory.capture.simulators.opencv:SimulatedOpenCvCamera",
)
