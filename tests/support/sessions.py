"""Sessions of chosen samples, written by the mcap library by the contract of recorded sessions."""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from mcap.writer import CompressionType, Writer
from numpy.typing import NDArray
from rosbags.typesys import Stores, get_typestore

from grasp_factory.writers.exporters.rosbag.message_maker import MessageMaker

START = 1_700_000_000_000_000_000
"""Time of the first samples, ns since the epoch."""
TYPES = get_typestore(Stores.ROS2_HUMBLE)
MAKE = MessageMaker(TYPES)
IMAGE, IMU = "sensor_msgs/msg/Image", "sensor_msgs/msg/Imu"
WRENCH, JOINTS = "geometry_msgs/msg/WrenchStamped", "sensor_msgs/msg/JointState"
STRING = "std_msgs/msg/String"


@dataclass(frozen=True, slots=True, kw_only=True)
class Channel:
    """A topic and the facts of its device."""

    topic: str
    kind: str
    """Type of its messages."""
    device: str = ""
    device_kind: str = ""
    has_device_time: bool = False
    has_sequence: bool = False


@dataclass(frozen=True, slots=True, kw_only=True)
class Recorded:
    """A message."""

    channel: Channel
    log_ns: int
    fields: Mapping[str, Any]
    device_ns: int | None = None
    sequence: int = 0


@dataclass(slots=True, kw_only=True)
class SessionMaker:
    """Writes a session; messages are in the order of their times."""

    messages: list[Recorded] = field(default_factory=list)
    settings: dict[str, Any] = field(default_factory=dict)
    calibration: dict[str, str] = field(default_factory=dict)

    def camera(
        self,
        images: Iterable[NDArray[np.uint8]],
        *,
        rate: float = 30.0,
        name: str = "cam",
        depth: Iterable[NDArray[np.uint16]] | None = None,
        skipped: Sequence[int] = (),
        depth_delay_ns: int = 0,
    ) -> SessionMaker:
        """Add a camera; its frames with the numbers ``skipped`` are lost."""
        topic = Channel(
            topic=f"/{name}/image", kind=IMAGE, device=name, device_kind="camera", has_sequence=True
        )
        depth_topic = Channel(
            topic=f"/{name}/depth", kind=IMAGE, device=name, device_kind="camera", has_sequence=True
        )
        depths = iter(depth) if depth is not None else None
        for k, image in enumerate(images):
            time = START + round(k * 1e9 / rate)
            of_depth = next(depths) if depths else None
            if k in skipped:
                continue
            self.messages.append(_recorded(topic, time, image_fields(image, "rgb8"), k))
            if of_depth is not None:
                fields = image_fields(of_depth, "16UC1")
                self.messages.append(_recorded(depth_topic, time + depth_delay_ns, fields, k))
        return self

    def imu(
        self,
        specific_force: NDArray[np.float64],
        angular_velocity: NDArray[np.float64],
        rate: float,
        name: str = "imu",
        clock: float = 1.0,
    ) -> SessionMaker:
        """Add an IMU with a clock of its own, of so many of its seconds in a second."""
        topic = Channel(
            topic=f"/{name}/imu",
            kind=IMU,
            device=name,
            device_kind="imu",
            has_device_time=True,
            has_sequence=True,
        )
        for k, (force, angular) in enumerate(zip(specific_force, angular_velocity, strict=True)):
            time = START + round(k * 1e9 / rate)
            fields = {
                "linear_acceleration": MAKE.vector(force.tolist()),
                "angular_velocity": MAKE.vector(angular.tolist()),
                "orientation_covariance": np.array([-1.0, *[0.0] * 8]),
            }
            device_ns = 5_000_000_000 + round(k * 1e9 / rate * clock)
            self.messages.append(_recorded(topic, time, fields, k % 2**32, device_ns=device_ns))
        return self

    def wrench(self, values: NDArray[np.float64], rate: float, name: str = "ft") -> SessionMaker:
        """Add a force-torque sensor without a clock."""
        topic = Channel(
            topic=f"/{name}/wrench", kind=WRENCH, device=name, device_kind="force_torque"
        )
        for k, row in enumerate(values.tolist()):
            made = MAKE(
                "geometry_msgs/msg/Wrench", force=MAKE.vector(row[:3]), torque=MAKE.vector(row[3:])
            )
            self.messages.append(
                _recorded(topic, START + round(k * 1e9 / rate), {"wrench": made}, 0)
            )
        return self

    def joints(self, positions: NDArray[np.float64], rate: float) -> SessionMaker:
        """Add the joints of a robot, (N, J) rad."""
        topic = Channel(topic="/arm/joint_states", kind=JOINTS, device="arm", device_kind="joints")
        for k, row in enumerate(positions):
            fields = {
                "name": [f"joint_{j}" for j in range(len(row))],
                "position": row,
                "velocity": np.zeros(len(row)),
                "effort": np.zeros(len(row)),
            }
            self.messages.append(_recorded(topic, START + round(k * 1e9 / rate), fields, 0))
        return self

    def taxels(self, image: NDArray[np.float32]) -> SessionMaker:
        """Add one sample of a tactile array."""
        topic = Channel(topic="/skin/taxels", kind=IMAGE, device="skin", device_kind="tactile")
        self.messages.append(_recorded(topic, START, image_fields(image, "32FC1"), 0))
        return self

    def event(self, text: str) -> SessionMaker:
        """Add an event at the start."""
        fields = {"data": json.dumps({"event": text, "time_ns": START})}
        topic = Channel(topic="/events", kind=STRING)
        self.messages.append(Recorded(channel=topic, log_ns=START, fields=fields))
        return self

    def write(self, folder: Path, **options: Any) -> Path:
        """Write the session's folder; ``options`` go to mcap's writer."""
        folder.mkdir()
        text = yaml.safe_dump(self.settings)
        (folder / "session.yaml").write_text(text)
        (folder / "session.json").write_text(json.dumps({"version": 1, "clean": True}))
        (folder / "calibration").mkdir()
        for name, content in self.calibration.items():
            (folder / "calibration" / name).write_text(content)
        with (folder / "session.mcap").open("wb") as file:
            writer = Writer(file, **{"compression": CompressionType.ZSTD, **options})
            writer.start("ros2", "grasp-factory tests")
            writer.add_metadata("grasp_factory.session", {"settings": text})
            for name, content in self.calibration.items():
                writer.add_attachment(1, 2, name, "application/yaml", content.encode())
            for channel, message in _with_ids(writer, self.messages):
                device_ns = message.log_ns if message.device_ns is None else message.device_ns
                writer.add_message(
                    channel, message.log_ns, cdr(message), device_ns, message.sequence
                )
            writer.finish()
        return folder


def image_fields(image: NDArray[Any], encoding: str) -> dict[str, Any]:
    """Return the fields of an image message."""
    return {
        "height": image.shape[0],
        "width": image.shape[1],
        "encoding": encoding,
        "step": image[0].nbytes,
        "data": np.ascontiguousarray(image).view(np.uint8).ravel(),
    }


def cdr(message: Recorded) -> bytes:
    """Return a message's bytes."""
    fields, kind = dict(message.fields), message.channel.kind
    if kind != STRING:
        fields["header"] = MAKE.header(message.log_ns, message.channel.device)
    return bytes(TYPES.serialize_cdr(MAKE(kind, **fields), kind, little_endian=True))


def _recorded(
    channel: Channel,
    log_ns: int,
    fields: Mapping[str, Any],
    sequence: int,
    device_ns: int | None = None,
) -> Recorded:
    return Recorded(
        channel=channel, log_ns=log_ns, fields=fields, sequence=sequence, device_ns=device_ns
    )


def _with_ids(writer: Writer, messages: list[Recorded]) -> Iterator[tuple[int, Recorded]]:
    schemas: dict[str, int] = {}
    channels: dict[str, int] = {}
    for message in sorted(messages, key=lambda each: each.log_ns):
        channel = message.channel
        if channel.kind not in schemas:
            text, _ = TYPES.generate_msgdef(channel.kind, ros_version=2)
            schemas[channel.kind] = writer.register_schema(channel.kind, "ros2msg", text.encode())
        if channel.topic not in channels:
            channels[channel.topic] = writer.register_channel(
                channel.topic, "cdr", schemas[channel.kind], _facts(channel)
            )
        yield channels[channel.topic], message


def _facts(channel: Channel) -> dict[str, str]:
    if not channel.device:
        return {}
    return {
        "device": channel.device,
        "driver": "simulated",
        "kind": channel.device_kind,
        "device_time": str(int(channel.has_device_time)),
        "device_sequence": str(int(channel.has_sequence)),
    }
