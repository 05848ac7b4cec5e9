"""What a stream did lately: counts in buckets of time, filled sample by sample."""

from __future__ import annotations

import threading
from collections import deque
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from grasp_factory.capture.devices.base import DeviceCounters
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
from grasp_factory.capture.session.session_config import DeviceConfig

CURVE_NS, CURVE_POINTS = 40_000_000, 500
"""A curve for people: least time between two of its points, and how many of the latest it has."""
MOST_BUCKETS = 60
"""Latest buckets that are kept."""
EACH = 8
"""Of an image, every so many rows and columns are compared with the image before."""
NOISY = {DeviceKind.CAMERA, DeviceKind.IMU, DeviceKind.FORCE_TORQUE}
"""Kinds whose values change always, so that values that do not change are a fault."""
BLACK, WHITE = 2, 253
"""Grey values up to and from which a pixel is clipped."""
FULL = 0.999
"""Share of the full scale from which a sample is saturated."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Bucket:
    """A stream from one look to the next."""

    start_ns: int
    end_ns: int = 0
    """Host times."""
    samples: int = 0
    longest_gap_ns: int = 0
    saturated: int = 0
    """Samples with a value at full scale; of a camera, images with too many clipped pixels."""
    least_offset_ns: int | None = None
    """The least host time minus device time: that of the sample that came with least delay."""
    bad_checksums: int = 0
    implausible: int = 0
    lost: int = 0
    reconnects: int = 0
    dropped: int = 0
    clock_backs: int = 0
    """How often the device's time was earlier than that of the sample before."""
    is_first: bool = False
    """Whether it is the first one of the session, in which the stream begins."""


@dataclass(frozen=True, slots=True, kw_only=True)
class StreamWindow:
    """A stream in its latest buckets, and now."""

    device: str
    kind: DeviceKind
    expected_hz: float | None
    buckets: tuple[Bucket, ...]
    """Oldest first."""
    silent_s: float
    """Seconds since the last sample, or since the start."""
    is_started: bool
    """Whether there has been a sample."""
    unchanged_s: float
    """Seconds for which samples came whose values did not change; 0 for kinds that may rest."""
    queue: float
    """Share of its queue to the disk that is full."""
    trouble: str = ""
    """Why the device is gone, or its samples cannot be stored; empty if all is well."""

    def latest(self, seconds: float) -> tuple[Bucket, ...]:
        """Return the latest buckets that cover so many seconds; fewer if there are fewer."""
        found: list[Bucket] = []
        for bucket in reversed(self.buckets):
            if found and found[0].end_ns - bucket.end_ns >= seconds * 1e9:
                break
            found.append(bucket)
        return tuple(reversed(found))


def rate_hz(buckets: tuple[Bucket, ...]) -> float:
    """Return samples per second; 0 without time."""
    span = sum(b.end_ns - b.start_ns for b in buckets)
    return 1e9 * sum(b.samples for b in buckets) / span if span > 0 else 0.0


class StreamStatistics:
    """Counts the samples of one device. Its thread adds; another one looks."""

    def __init__(
        self,
        device: str,
        kind: DeviceKind,
        config: DeviceConfig,
        clipped: float,
        start_ns: int,
    ) -> None:
        """Begin.

        Args:
            device: its name.
            kind: what it yields.
            config: its settings.
            clipped: share of an image's pixels that may be clipped.
            start_ns: host time.
        """
        self.total = 0
        self.latest: Sample[Payload] | None = None
        self.longest_gap_ns = self._first_ns = 0
        self._device, self._kind, self._config, self._clipped = device, kind, config, clipped
        self._start_ns = start_ns
        self._curve: deque[tuple[int, NDArray[Any]]] = deque(maxlen=CURVE_POINTS)
        self._buckets: deque[Bucket] = deque(maxlen=MOST_BUCKETS)
        self._lock = threading.Lock()
        self._shown: NDArray[Any] | None = None
        self._changed_ns = start_ns
        self._seen = DeviceCounters()
        self._seen_dropped = 0
        self._begin(start_ns)

    def _begin(self, now_ns: int) -> None:
        self._samples = self._gap_ns = self._saturated = self._clock_backs = 0
        self._offset_ns: int | None = None
        self._bucket_ns = now_ns

    def add(self, sample: Sample[Payload]) -> None:
        """Count a sample."""
        values = shown_values(sample.payload)
        is_same = (
            self._shown is not None
            and self._shown.shape == values.shape
            and bool((self._shown == values).all())
        )
        saturated = self._is_saturated(sample.payload, values)
        with self._lock:
            gap = sample.host_ns - self.latest.host_ns if self.latest else 0
            self._gap_ns = max(self._gap_ns, gap)
            self.longest_gap_ns = max(self.longest_gap_ns, gap)
            self._watch_clock(sample)
            self._first_ns = self._first_ns if self.total else sample.host_ns
            self.latest, self._shown = sample, values
            self.total += 1
            self._samples += 1
            self._saturated += saturated
            is_due = not self._curve or sample.host_ns - self._curve[-1][0] >= CURVE_NS
            if is_due and values.ndim == 1:
                self._curve.append((sample.host_ns, values))
            if not is_same:
                self._changed_ns = sample.host_ns

    def _watch_clock(self, sample: Sample[Payload]) -> None:
        if sample.device_ns is None:
            return
        offset = sample.host_ns - sample.device_ns
        least, before = self._offset_ns, self.latest.device_ns if self.latest else None
        self._offset_ns = offset if least is None else min(least, offset)
        self._clock_backs += before is not None and sample.device_ns < before

    def look(
        self,
        now_ns: int,
        counters: DeviceCounters,
        *,
        dropped: int,
        queue: float,
        trouble: str,
    ) -> StreamWindow:
        """End the present bucket, and return the window; see its fields."""
        with self._lock:
            self._buckets.append(self._ended(now_ns, counters, dropped))
            self._begin(now_ns)
            last = self.latest.host_ns if self.latest else self._start_ns
            unchanged = max(0, last - self._changed_ns) if self._kind in NOISY else 0
            return StreamWindow(
                device=self._device,
                kind=self._kind,
                expected_hz=self._config.rate_hz,
                buckets=tuple(self._buckets),
                silent_s=max(0, now_ns - last) / 1e9,
                is_started=self.latest is not None,
                unchanged_s=unchanged / 1e9,
                queue=queue,
                trouble=trouble,
            )

    def _ended(self, now_ns: int, counters: DeviceCounters, dropped: int) -> Bucket:
        seen, self._seen = self._seen, replace(counters)
        before, self._seen_dropped = self._seen_dropped, dropped
        return Bucket(
            start_ns=self._bucket_ns,
            end_ns=now_ns,
            samples=self._samples,
            longest_gap_ns=self._gap_ns,
            saturated=self._saturated,
            least_offset_ns=self._offset_ns,
            bad_checksums=counters.bad_checksums - seen.bad_checksums,
            implausible=counters.implausible - seen.implausible,
            lost=counters.lost - seen.lost,
            reconnects=counters.reconnects - seen.reconnects,
            dropped=dropped - before,
            clock_backs=self._clock_backs,
            is_first=self._bucket_ns == self._start_ns,
        )

    def mean_rate_hz(self) -> float:
        """Return samples per second from the first to the last one; 0 with fewer than two."""
        with self._lock:
            span = self.latest.host_ns - self._first_ns if self.latest else 0
            return 1e9 * (self.total - 1) / span if span > 0 else 0.0

    def latest_curve(self) -> list[tuple[int, NDArray[Any]]]:
        """Return host times and values of some of the latest samples."""
        with self._lock:
            return list(self._curve)

    def _is_saturated(self, payload: Payload, values: NDArray[Any]) -> bool:
        if isinstance(payload, CameraFrame):
            ends = ((values <= BLACK) | (values >= WHITE)).all(axis=-1)
            return bool(ends.mean() > self._clipped)
        return any(
            np.abs(quantity(payload, name)).max(initial=0.0) >= FULL * most
            for name, most in self._config.full_scale.items()
        )


def quantity(payload: Payload, name: str) -> NDArray[Any]:
    """Return the values of a quantity of a sample, as named in ``topic_names.QUANTITIES``."""
    if isinstance(payload, WrenchReading):
        return payload.wrench[:3] if name == "force" else payload.wrench[3:]
    found: NDArray[Any] = getattr(payload, name)
    return found


def shown_values(payload: Payload) -> NDArray[Any]:
    """Return values that tell one sample from the next; of an image, a part of the pixels."""
    match payload:
        case CameraFrame():
            return payload.rgb[::EACH, ::EACH].copy()
        case InertialReading():
            return np.concatenate([payload.specific_force, payload.angular_velocity])
        case WrenchReading():
            return payload.wrench
        case TactileReading():
            return payload.pressure
        case JointReading():
            width = [] if np.isnan(payload.gripper_width) else [payload.gripper_width]
            return np.concatenate([payload.positions, width])
