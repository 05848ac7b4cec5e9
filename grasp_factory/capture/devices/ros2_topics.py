"""Drivers that read topics of ROS 2: cameras, IMUs, force-torque sensors and joints.

The device's time is the stamp of a message's header. ROS 2 has no count of messages, so ``lost``
stays 0; gaps show in the stamps.
"""

from __future__ import annotations

import time
from abc import ABC, abstractmethod
from collections.abc import Iterator
from dataclasses import replace
from threading import Event
from typing import Any, Generic, TypeVar

from grasp_factory.capture.bags.payloads import (
    colour_pixels,
    depth_pixels,
    imu_reading,
    joint_reading,
    wrench_reading,
)
from grasp_factory.capture.bags.pixel_decoding import decode_image
from grasp_factory.capture.devices.base import DeviceCounters
from grasp_factory.capture.devices.ros2 import (
    Ros2CameraSettings,
    Ros2JointSettings,
    Ros2Settings,
)
from grasp_factory.capture.ros2.discovery import PublishedTopic, TopicWatch
from grasp_factory.capture.ros2.message_stamp import stamp_of
from grasp_factory.capture.ros2.message_types import decoded
from grasp_factory.capture.ros2.network import Participant, Ros2Network
from grasp_factory.capture.ros2.stamp_pairs import StampPairs
from grasp_factory.capture.ros2.subscriber import Inbox, ReceivedMessage, TopicSubscriber
from grasp_factory.capture.samples import (
    CameraFrame,
    InertialReading,
    JointReading,
    Payload,
    Sample,
    WrenchReading,
)
from grasp_factory.errors import CaptureError

_POLL_S = 0.05
_DEPTH = 0
"""Keep all messages until they are taken."""
S = TypeVar("S", bound=Ros2Settings)
P = TypeVar("P", bound=Payload)


class Ros2Device(ABC, Generic[S, P]):
    """A driver that reads one or two topics; see ``Device``."""

    message_type: str

    def __init__(self, settings: S) -> None:
        self.counters = DeviceCounters()
        self._settings = settings
        self._stopped = Event()
        self._inbox: Inbox | None = None

    def open(self) -> None:
        """See ``Device.open``."""
        settings = self._settings
        network = Ros2Network(domain_id=settings.domain_id, interface=settings.interface)
        participant = Participant(network)
        found = TopicWatch(participant).wait_for(settings.topics, settings.match_s)
        subscribers = [self._subscriber(participant, found[name]) for name in settings.topics]
        self._inbox = Inbox(participant, subscribers)

    def _subscriber(self, participant: Participant, topic: PublishedTopic) -> TopicSubscriber:
        if topic.kinds != (self.message_type,):
            got = ", ".join(topic.kinds)
            raise CaptureError(f"{topic.name}: got {got}, valid: {self.message_type}")
        return TopicSubscriber(participant, topic.name, self.message_type, topic.quality(_DEPTH))

    def samples(self) -> Iterator[Sample[P]]:
        """See ``Device.samples``."""
        assert self._inbox is not None, "open comes first"
        heard = time.monotonic()
        while not self._stopped.is_set():
            messages = self._inbox.take(_POLL_S)
            now = time.monotonic()
            if messages:
                heard = now
            elif now - heard >= self._settings.reconnect_s:
                raise CaptureError(
                    f"{self._settings.topic}: no message for {self._settings.reconnect_s:g} s:"
                    " start its publisher again, or raise the setting reconnect_s"
                )
            for message in messages:
                yield from self._samples_of(message)

    def _samples_of(self, message: ReceivedMessage) -> list[Sample[P]]:
        try:
            found = self.decode(message)
        except ValueError:
            self.counters.implausible += 1
            return []
        self.counters.samples += len(found)
        return found

    @abstractmethod
    def decode(self, message: ReceivedMessage) -> list[Sample[P]]:
        """Return the samples that a message completes.

        Raises:
            ValueError: if it cannot be decoded.
        """

    def stop(self) -> None:
        """See ``Device.stop``."""
        self._stopped.set()

    def close(self) -> None:
        """See ``Device.close``."""
        self._inbox = None


class Ros2Imu(Ros2Device[Ros2Settings, InertialReading]):
    """Driver of an IMU."""

    message_type = "sensor_msgs/msg/Imu"

    def decode(self, message: ReceivedMessage) -> list[Sample[InertialReading]]:
        """See ``Ros2Device.decode``."""
        return [_sample(message, imu_reading(decoded(message.kind, message.data)))]


class Ros2ForceTorque(Ros2Device[Ros2Settings, WrenchReading]):
    """Driver of a force-torque sensor."""

    message_type = "geometry_msgs/msg/WrenchStamped"

    def decode(self, message: ReceivedMessage) -> list[Sample[WrenchReading]]:
        """See ``Ros2Device.decode``."""
        return [_sample(message, wrench_reading(decoded(message.kind, message.data)))]


class Ros2Joints(Ros2Device[Ros2JointSettings, JointReading]):
    """Driver of an arm: a sample for each measured state, with the latest command."""

    message_type = "sensor_msgs/msg/JointState"

    def __init__(self, settings: Ros2JointSettings) -> None:
        super().__init__(settings)
        self._command: Any | None = None

    def decode(self, message: ReceivedMessage) -> list[Sample[JointReading]]:
        """See ``Ros2Device.decode``."""
        found = decoded(message.kind, message.data)
        if message.topic != self._settings.topic:
            self._command = found
            return []
        return [_sample(message, joint_reading(found, self._command, self._settings.gripper))]


class Ros2Camera(Ros2Device[Ros2CameraSettings, CameraFrame]):
    """Driver of a camera. Colour and depth of nearly the same stamp are one frame."""

    message_type = "sensor_msgs/msg/Image"

    def __init__(self, settings: Ros2CameraSettings) -> None:
        super().__init__(settings)
        tolerance_ns = round(settings.depth_tolerance_s * 1e9)
        self._pairs: StampPairs[Sample[CameraFrame], Any] = StampPairs(tolerance_ns)

    def decode(self, message: ReceivedMessage) -> list[Sample[CameraFrame]]:
        """See ``Ros2Device.decode``."""
        found = decoded(message.kind, message.data)
        stamp = stamp_of(message.kind, message.data) or 0
        if message.topic == self._settings.topic:
            sample = _sample(message, CameraFrame(rgb=colour_pixels(decode_image(found))))
            if not self._settings.depth_topic:
                return [sample]
            pairs = self._pairs.add_left(stamp, sample)
        else:
            pairs = self._pairs.add_right(stamp, depth_pixels(decode_image(found)))
        self.counters.lost = self._pairs.single
        return [_with_depth(*pair) for pair in pairs]


def _with_depth(sample: Sample[CameraFrame], depth: Any) -> Sample[CameraFrame]:
    if depth.shape != sample.payload.rgb.shape[:2]:
        raise ValueError("depth and colour images have different sizes")
    return replace(sample, payload=CameraFrame(rgb=sample.payload.rgb, depth=depth))


def _sample(message: ReceivedMessage, payload: P) -> Sample[P]:
    return Sample(
        device_ns=stamp_of(message.kind, message.data),
        host_ns=message.host_ns,
        sequence=None,
        payload=payload,
    )
