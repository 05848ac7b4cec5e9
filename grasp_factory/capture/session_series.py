"""The time series of a session's devices as arrays."""

from __future__ import annotations

import math
from array import array
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from grasp_factory.capture.bags.payloads import GRIPPER
from grasp_factory.capture.ros_messages import IMU, JOINT_STATE, TEMPERATURE, WRENCH, decoded
from grasp_factory.capture.samples import DeviceKind
from grasp_factory.capture.session_reader import SessionMessage, SessionTopic, opened_session
from grasp_factory.core.executors import SendMessage
from grasp_factory.core.executors.import_process import in_import_process
from grasp_factory.core.executors.limited import ProcessLimits
from grasp_factory.core.geometry import Array
from grasp_factory.core.limits import SESSION_CPU, SESSION_FILE, SESSION_MEMORY
from grasp_factory.errors import CaptureError, shown
from grasp_factory.signals.timeline import Ticks

SESSION_LIMITS = ProcessLimits(
    what="reading the session", memory=SESSION_MEMORY, cpu=SESSION_CPU, file=SESSION_FILE
)
"""Of a process that reads a session."""

_WRAP = 2**32
_LATEST_NS = 2**63 - 1
"""Ticks in MCAP files may be later; they become this one."""


@dataclass(frozen=True, slots=True, kw_only=True)
class DeviceSeries:
    """All messages of one topic, in the order in which they were recorded."""

    topic: str
    message_type: str
    device: str
    kind: DeviceKind | None
    log_time_ns: Ticks
    """(N,) time of the host, ns since the epoch."""
    device_ns: Ticks | None
    """(N,) time of the device, ns from an instant that only it knows; None without a clock."""
    sequence: Ticks | None
    """(N,) the device's count, unwrapped; None if it does not count."""
    values: Mapping[str, Array]
    """By name, (N, ...) in SI units; nothing for images and texts."""
    has_gripper: bool = False
    """Whether the last column of joints is the gripper; NaN in messages without it."""

    def __len__(self) -> int:
        return len(self.log_time_ns)


@dataclass(slots=True)
class SeriesBuilder:
    """Collects the messages of one topic, as numbers of 8 bytes each."""

    topic: SessionTopic
    _log_times: array[int] = field(default_factory=lambda: array("q"))
    _device_times: array[int] = field(default_factory=lambda: array("q"))
    _sequences: array[int] = field(default_factory=lambda: array("q"))
    _values: dict[str, array[float]] = field(default_factory=dict)
    _widths: set[tuple[int, ...]] = field(default_factory=set)
    """Numbers of values that messages have."""
    _has_gripper: bool = False

    def add(self, message: SessionMessage) -> None:
        """Append a message.

        Raises:
            CaptureError: if it cannot be decoded.
        """
        self._log_times.append(min(message.log_time_ns, _LATEST_NS))
        self._device_times.append(min(message.publish_time_ns, _LATEST_NS))
        self._sequences.append(message.sequence)
        reader = _READERS.get(message.topic.message_type)
        if reader:
            names, read = reader
            fields = decoded(message)
            row = read(fields)
            if message.topic.message_type == JOINT_STATE:
                row = self._with_gripper_last(fields.name, row)
            self._widths.add(tuple(map(len, row)))
            for name, values in zip(names, row, strict=True):
                self._values.setdefault(name, array("d")).extend(values)

    def series(self) -> DeviceSeries:
        """Return the arrays.

        Raises:
            CaptureError: if messages have different numbers of values.
        """
        topic = self.topic
        sequence = np.array(self._sequences, np.int64)
        return DeviceSeries(
            topic=topic.name,
            message_type=topic.message_type,
            device=topic.device,
            kind=topic.kind,
            log_time_ns=np.array(self._log_times, np.int64),
            device_ns=np.array(self._device_times, np.int64) if topic.has_device_time else None,
            sequence=unwrapped(sequence) if topic.has_device_sequence else None,
            values=self._arrays(),
            has_gripper=self._has_gripper,
        )

    def _with_gripper_last(
        self, names: list[str], row: tuple[list[float], ...]
    ) -> tuple[list[float], ...]:
        """Return values of joints with the gripper last: NaN if the message does not have it."""
        if any(len(values) not in (0, len(names)) for values in row):
            raise CaptureError(f"{shown(self.topic.name)} has values that its names do not fit")
        place = names.index(GRIPPER) if GRIPPER in names else None
        self._has_gripper |= place is not None
        return tuple(_moved_last(list(values), place) for values in row)

    def _arrays(self) -> dict[str, Array]:
        if len(self._widths) > 1:
            raise CaptureError(
                f"messages of {shown(self.topic.name)} have different numbers of values"
            )
        widths = next(iter(self._widths), ())
        found = {
            name: np.array(values, np.float64).reshape(len(self._log_times), width)
            for (name, values), width in zip(self._values.items(), widths, strict=True)
        }
        if self.topic.message_type == JOINT_STATE and not self._has_gripper:
            return {name: values[:, :-1] for name, values in found.items()}
        return found


def read_series(session: Path) -> dict[str, DeviceSeries]:
    """Return the series of all topics by name; a process with limits reads the session.

    Images and texts have times, but no values. The arrays are in memory.

    Raises:
        CaptureError: if it is no session, or damaged.
        StoreError: if it needs too much memory or time.
    """
    found: dict[str, DeviceSeries] = in_import_process(
        _series_of, session, session, limits=SESSION_LIMITS
    )
    return found


def _series_of(session: Path, report: SendMessage) -> dict[str, DeviceSeries]:
    builders: dict[str, SeriesBuilder] = {}
    with opened_session(session) as reader:
        for message in reader.messages():
            name = message.topic.name
            builders.setdefault(name, SeriesBuilder(message.topic)).add(message)
    return {name: builders[name].series() for name in sorted(builders)}


def unwrapped(sequence: Ticks) -> Ticks:
    """Return a count modulo 2**32 as a count that goes on.

    A step of more than half of the range is one back.

    Args:
        sequence: (N,) 0 to 2**32 - 1.
    """
    if not len(sequence):
        return sequence
    steps = np.diff(sequence) % _WRAP
    steps = np.where(steps >= _WRAP // 2, steps - _WRAP, steps)
    return np.concatenate([sequence[:1], sequence[0] + np.cumsum(steps)])


def _moved_last(values: list[float], place: int | None) -> list[float]:
    if not values:
        return values
    last = math.nan if place is None else values.pop(place)
    return [*values, last]


def _xyz(vector: Any) -> list[float]:
    return [vector.x, vector.y, vector.z]


def _imu(message: Any) -> tuple[list[float], ...]:
    return _xyz(message.linear_acceleration), _xyz(message.angular_velocity)


def _wrench(message: Any) -> tuple[list[float], ...]:
    return ([*_xyz(message.wrench.force), *_xyz(message.wrench.torque)],)


def _joints(message: Any) -> tuple[list[float], ...]:
    return message.position, message.velocity, message.effort


def _temperature(message: Any) -> tuple[list[float], ...]:
    return ([message.temperature],)


_READERS: Mapping[str, tuple[tuple[str, ...], Callable[[Any], tuple[list[float], ...]]]] = {
    IMU: (("specific_force", "angular_velocity"), _imu),
    WRENCH: (("wrench",), _wrench),
    JOINT_STATE: (("positions", "velocities", "efforts"), _joints),
    TEMPERATURE: (("temperature",), _temperature),
}
"""By type of messages: the names of its arrays, and a function to their rows."""
