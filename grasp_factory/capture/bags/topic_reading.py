"""Reading one topic of a bag as a device's samples, in a process with limits."""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from rosbags.highlevel import AnyReader
from rosbags.interfaces import Connection

from grasp_factory.capture.bags.bag_file import opened, raw_messages
from grasp_factory.capture.bags.messages import is_standard, message_of, stamp_ns_of
from grasp_factory.capture.bags.payloads import (
    GRIPPER,
    colour_pixels,
    depth_pixels,
    imu_reading,
    joint_reading,
    taxel_reading,
    wrench_reading,
)
from grasp_factory.capture.bags.pixel_decoding import (
    DecodedImage,
    decode_compressed_image,
    decode_image,
)
from grasp_factory.capture.samples import CameraFrame, DeviceKind, Payload
from grasp_factory.core.executors import SendMessage
from grasp_factory.core.scratch_folder import scratch_folder
from grasp_factory.errors import CaptureError, lookup

_MOST_WAITING = 8
"""Images that wait for their depth."""
_LATEST_NS = 2**63 - 1
_IMAGES: Mapping[str, Callable[[Any], DecodedImage]] = {
    "sensor_msgs/msg/Image": decode_image,
    "sensor_msgs/msg/CompressedImage": decode_compressed_image,
}
_READINGS: Mapping[DeviceKind, tuple[str, Callable[[Any], Payload]]] = {
    DeviceKind.IMU: ("sensor_msgs/msg/Imu", imu_reading),
    DeviceKind.FORCE_TORQUE: ("geometry_msgs/msg/WrenchStamped", wrench_reading),
    DeviceKind.TACTILE: ("sensor_msgs/msg/Image", taxel_reading),
    DeviceKind.JOINTS: (
        "sensor_msgs/msg/JointState",
        lambda message: joint_reading(message, None, GRIPPER),
    ),
}
"""By kind of device: the type of its messages, and the function that makes a payload."""
Stamped = tuple[int, Payload | None]
"""Time (ns) and payload; None for a message that cannot be decoded."""


@dataclass(frozen=True, slots=True, kw_only=True)
class TopicJob:
    """The task of the process that reads a topic."""

    bag: Path
    kind: DeviceKind
    topic: str
    depth_topic: str = ""
    """For a camera: the topic of its depth; empty for none."""
    slop_ns: int = 0
    """How far the times of an image and its depth may be apart."""


def read_topic(job: TopicJob, report: SendMessage) -> None:
    """Report the samples of a topic, ``Stamped``, in the order of the bag.

    Raises:
        UsageError: if it is no bag, or has no such topic.
        CaptureError: if the topic's type does not fit the kind of device.
        StoreError: if the bag is damaged.
    """
    with (
        scratch_folder(Path(tempfile.gettempdir()), "grasp-factory-bag") as aside,
        opened(job.bag, aside) as reader,
    ):
        topic = _TopicReader(job, reader)
        for connection, arrival, data in raw_messages(job.bag, reader, _connections(job, reader)):
            for found in topic.decoded(connection, arrival, data):
                report(found)
        for found in topic.pairs.rest():
            report(found)


def _connections(job: TopicJob, reader: AnyReader) -> list[Connection]:
    """Return the connections of the job's topics."""
    by_topic: dict[str, list[Connection]] = {}
    for connection in reader.connections:
        by_topic.setdefault(connection.topic, []).append(connection)
    is_camera = job.kind is DeviceKind.CAMERA
    kinds = tuple(_IMAGES) if is_camera else (_READINGS[job.kind][0],)
    chosen = []
    for topic in filter(None, (job.topic, job.depth_topic)):
        for connection in lookup(by_topic, "topic", topic):
            got = connection.msgtype
            if got not in kinds or not is_standard(reader, got):
                raise CaptureError(
                    f"{job.bag}: {topic} has messages of {got}, valid: {', '.join(kinds)}"
                )
            chosen.append(connection)
    return chosen


class _TopicReader:
    """Decodes messages, and brings images and depth together."""

    def __init__(self, job: TopicJob, reader: AnyReader) -> None:
        self._job, self._reader = job, reader
        self.pairs = _Pairs(job.slop_ns)

    def decoded(self, connection: Connection, arrival: int, data: bytes) -> Iterator[Stamped]:
        """Yield the samples that are complete with a message."""
        job, kind = self._job, connection.msgtype
        try:
            message = message_of(self._reader, connection, data)
            stamp = stamp_ns_of(message)
            time_ns = min(arrival, _LATEST_NS) if stamp is None else stamp
            if job.depth_topic and connection.topic == job.depth_topic:
                depth = depth_pixels(_IMAGES[kind](message))
                yield from self.pairs.add_depth(time_ns, depth)
                return
            payload: Payload
            if job.kind is DeviceKind.CAMERA:
                payload = CameraFrame(rgb=colour_pixels(_IMAGES[kind](message)))
            else:
                payload = _READINGS[job.kind][1](message)
        except ValueError:
            yield 0, None
            return
        if job.depth_topic and isinstance(payload, CameraFrame):
            yield from self.pairs.add_image(time_ns, payload)
        else:
            yield time_ns, payload


class _Pairs:
    """Images that wait for the depth of their instant, and depth that waits for its image."""

    def __init__(self, slop_ns: int) -> None:
        self._slop_ns = slop_ns
        self._images: list[tuple[int, CameraFrame]] = []
        self._depths: list[tuple[int, Any]] = []

    def add_image(self, time_ns: int, image: CameraFrame) -> Iterator[Stamped]:
        self._images.append((time_ns, image))
        return self._matched()

    def add_depth(self, time_ns: int, depth: Any) -> Iterator[Stamped]:
        self._depths = [*self._depths[1 - _MOST_WAITING :], (time_ns, depth)]
        return self._matched()

    def rest(self) -> Iterator[Stamped]:
        """Yield the images whose depth did not come."""
        yield from self._images

    def _matched(self) -> Iterator[Stamped]:
        """Yield images in order: with their depth, or without it when it will not come."""
        while self._images:
            time_ns, image = self._images[0]
            near = [pair for pair in self._depths if abs(pair[0] - time_ns) <= self._slop_ns]
            is_past = any(at > time_ns + self._slop_ns for at, _ in self._depths)
            if not near and not is_past and len(self._images) < _MOST_WAITING:
                return
            depth = min(near, key=lambda pair: abs(pair[0] - time_ns))[1] if near else None
            if depth is not None and depth.shape != image.rgb.shape[:2]:
                depth = None
            del self._images[0]
            yield time_ns, replace(image, depth=depth)
