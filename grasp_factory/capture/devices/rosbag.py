"""Players of bags: a topic of a ROS 1 or ROS 2 bag as a device, at any speed.

There is a row for each kind of device. The bag is read in a process with limits, for it may be
anybody's. The device time is the stamp of a message's header.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from threading import Event
from typing import Any, ClassVar

from grasp_factory.capture.devices.base import DeviceCounters, DeviceModel
from grasp_factory.capture.devices.pacing import Pacer
from grasp_factory.capture.samples import DeviceKind, Payload, Sample
from grasp_factory.capture.transport.task_stream import TaskStream, limited_stream
from grasp_factory.core.serialization import check, check_range, normalise
from grasp_factory.errors import CaptureError

_OPENING_S = 60.0
_NS = 1e9


@dataclass(frozen=True, slots=True, kw_only=True)
class RosbagSettings:
    """The settings of the players."""

    path: str
    """A .bag of ROS 1, a .mcap or .db3 file, or a folder with metadata.yaml."""
    topic: str
    """The topic to play."""
    speed: float = 1.0
    """How much faster than it was recorded; 0 for as fast as possible."""

    def __post_init__(self) -> None:
        normalise(self)
        for name in ("path", "topic"):
            text = getattr(self, name)
            check(0 < len(text) <= 1000 and "\0" not in text, name, text, "a name")
        check_range(self, "speed", 0.0, 1000.0)


@dataclass(frozen=True, slots=True, kw_only=True)
class RosbagCameraSettings(RosbagSettings):
    """The settings of the player of cameras."""

    depth_topic: str = ""
    """The topic with depth, aligned with the images; empty for none."""
    slop_s: float = 0.005
    """How far the stamps of an image and its depth may be apart."""

    def __post_init__(self) -> None:
        RosbagSettings.__post_init__(self)
        text = self.depth_topic
        check(len(text) <= 1000 and "\0" not in text, "depth_topic", text, "a name, or nothing")
        check_range(self, "slop_s", 0.0, 1.0, "s")


class RosbagPlayer:
    """The driver; each subclass plays one kind."""

    kind: ClassVar[DeviceKind]

    def __init__(self, settings: RosbagSettings) -> None:
        self.counters = DeviceCounters()
        self._settings, self._stopped = settings, Event()
        self._stream: TaskStream | None = None
        self._first: list[Any] = []

    def open(self) -> None:
        """See ``Device.open``."""
        from grasp_factory.capture.bags.topic_reading import (  # noqa: PLC0415
            TopicJob,
            read_topic,
        )

        settings = self._settings
        depth: dict[str, Any] = {}
        if isinstance(settings, RosbagCameraSettings):
            depth = {"depth_topic": settings.depth_topic, "slop_ns": round(settings.slop_s * _NS)}
        job = TopicJob(bag=Path(settings.path), kind=self.kind, topic=settings.topic, **depth)
        self._stopped.clear()
        self.counters = DeviceCounters()
        self._stream = limited_stream(read_topic, job, job.bag)
        first = self._stream.first(_OPENING_S)
        if first is None:
            self.close()
            raise CaptureError(f"{settings.path} has no messages of {settings.topic}")
        self._first = [first]

    def samples(self) -> Iterator[Sample[Any]]:
        """See ``Device.samples``."""
        pacer = Pacer(self._settings.speed)
        for time_ns, payload in self._messages():
            if payload is None:
                self.counters.implausible += 1
                continue
            pacer.wait(time_ns, self._stopped)
            if self._stopped.is_set():
                return
            self.counters.samples += 1
            yield Sample(
                device_ns=time_ns, host_ns=time.monotonic_ns(), sequence=None, payload=payload
            )

    def stop(self) -> None:
        """See ``Device.stop``."""
        self._stopped.set()

    def close(self) -> None:
        """See ``Device.close``."""
        stream, self._stream = self._stream, None
        if stream is not None:
            stream.close()

    def _messages(self) -> Iterator[tuple[int, Payload | None]]:
        first, self._first = self._first, []
        if self._stream is not None:
            yield from first
            yield from self._stream.items(self._stopped)


class RosbagCamera(RosbagPlayer):
    """Plays images, with their depth if it is asked for."""

    kind = DeviceKind.CAMERA


class RosbagImu(RosbagPlayer):
    """Plays an IMU."""

    kind = DeviceKind.IMU


class RosbagForceTorque(RosbagPlayer):
    """Plays wrenches."""

    kind = DeviceKind.FORCE_TORQUE


class RosbagTactile(RosbagPlayer):
    """Plays taxels."""

    kind = DeviceKind.TACTILE


class RosbagJoints(RosbagPlayer):
    """Plays states of joints."""

    kind = DeviceKind.JOINTS


def _model(driver: type[RosbagPlayer], message: str) -> DeviceModel:
    name = f"rosbag_{driver.kind.name.lower()}"
    is_camera = driver.kind is DeviceKind.CAMERA
    return DeviceModel(
        name=name,
        kind=driver.kind,
        description=f"a topic of a ROS 1 or ROS 2 bag with messages of {message}",
        settings=RosbagCameraSettings if is_camera else RosbagSettings,
        implementation=f"grasp_factory.capture.devices.rosbag:{driver.__name__}",
        simulator=f"grasp_factory.capture.simulators.rosbag:Simulated{driver.__name__}",
        modules=("rosbags",),
        extra="ros",
    )


ROSBAG_MODELS = (
    _model(RosbagCamera, "Image or CompressedImage"),
    _model(RosbagImu, "Imu"),
    _model(RosbagForceTorque, "WrenchStamped"),
    _model(RosbagTactile, "Image (32FC1)"),
    _model(RosbagJoints, "JointState"),
)
