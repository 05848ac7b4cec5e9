"""One device of a session: a thread that reads it, and a bounded queue to the writer."""

from __future__ import annotations

import math
import threading
import time
from dataclasses import dataclass, fields, replace
from queue import SimpleQueue

from grasp_factory.capture.devices.base import Device, DeviceCounters, DeviceModel
from grasp_factory.capture.samples import JointReading, Payload, Sample
from grasp_factory.capture.session import events
from grasp_factory.capture.session.camera_info import CameraIntrinsics
from grasp_factory.capture.session.events import EventLog, SessionEvent
from grasp_factory.capture.session.session_config import DeviceConfig
from grasp_factory.capture.session.stream_statistics import StreamStatistics, StreamWindow
from grasp_factory.errors import CaptureError

AGAIN_S = 2.0
"""Seconds until a device that did not come back is opened again."""
ENDS_S = 2.0
"""Seconds that the thread of a device may take to end."""
UNKNOWN_HZ = 1000.0
"""The rate by which the queue of a device without an expected rate is sized."""
SHORTEST_QUEUE = 32
"""Samples."""


@dataclass(frozen=True, slots=True)
class Queued:
    """A sample on its way to the writer."""

    station: DeviceStation
    sample: Sample[Payload]


Outbox = SimpleQueue[Queued | SessionEvent | None]
"""The queue to the writer; None only wakes it."""


class DeviceStation:
    """Reads one device until it is stopped.

    A device that is gone for good is opened again every ``AGAIN_S`` seconds, for as long as the
    session runs. Samples that find the queue full are dropped and counted.

    Attributes:
        name: the device's name.
        model: its row of the table of devices.
        statistics: what it sent.
        dropped: samples that were not queued.
        unwritable: samples that could not be stored; only the writer changes it.
        trouble: why it is gone, or why its samples cannot be stored; empty if all is well.
    """

    def __init__(
        self,
        name: str,
        config: DeviceConfig,
        model: DeviceModel,
        topics: dict[str, str],
        intrinsics: CameraIntrinsics | None,
        *,
        clipped: float,
        queue_s: float,
        outbox: Outbox,
        log: EventLog,
    ) -> None:
        self.name, self.model, self.topics = name, model, topics
        self.intrinsics = intrinsics
        self.dropped = self.unwritable = self.taken = 0
        self.trouble = ""
        self._config, self._outbox, self._log = config, outbox, log
        self._clipped = clipped
        self._most = max(SHORTEST_QUEUE, math.ceil(queue_s * (config.rate_hz or UNKNOWN_HZ)))
        self._queued = self._reconnects = 0
        self._is_stopped = False
        self._over = threading.Event()
        self._before = DeviceCounters()
        self._device: Device[Payload] = model.make(config.settings)
        self.statistics = self._new_statistics()
        self._thread = threading.Thread(target=self._run, name=f"device {name}", daemon=True)
        self.metadata = {"device": name, "driver": model.name, "kind": model.kind.name.lower()}

    def open(self) -> None:
        """Connect.

        Raises:
            CaptureError: if the device is not there.
        """
        try:
            self._device.open()
        except CaptureError as error:
            raise CaptureError(f"device {self.name}: {error}") from None

    def start(self) -> None:
        """Begin to read."""
        self.statistics = self._new_statistics()
        self._thread.start()

    def ask_to_stop(self) -> None:
        """Ask the thread to end; return at once."""
        self._over.set()
        self._device.stop()

    def end(self) -> bool:
        """Wait until the thread has ended, and close the device; return whether it has."""
        if self._thread.is_alive():
            self._thread.join(ENDS_S)
        is_over = not self._thread.is_alive()
        if is_over:
            self._device.close()
        return is_over

    def counters(self) -> DeviceCounters:
        """Return what all drivers of the device counted since the start."""
        now = self._device.counters
        return DeviceCounters(
            **{f.name: getattr(now, f.name) + getattr(self._before, f.name) for f in fields(now)}
        )

    @property
    def is_running(self) -> bool:
        """Whether more samples may come."""
        return self._thread.is_alive()

    def look(self, now_ns: int) -> StreamWindow:
        """Return the latest statistics; see ``StreamStatistics.look``."""
        queue = (self._queued - self.taken) / self._most
        return self.statistics.look(
            now_ns,
            self.counters(),
            dropped=self.dropped,
            queue=queue,
            trouble=self.trouble,
        )

    def _new_statistics(self) -> StreamStatistics:
        return StreamStatistics(
            self.name, self.model.kind, self._config, self._clipped, time.monotonic_ns()
        )

    def _run(self) -> None:
        while not self._over.is_set():
            try:
                self._read()
                if not self._over.is_set():
                    self._log.add(events.DEVICE_ENDED, {"device": self.name})
                return
            except Exception as error:  # of a driver: the other devices go on
                self._lose(error)
            while not self._over.wait(AGAIN_S) and not self._is_back():
                pass

    def _read(self) -> None:
        for sample in self._device.samples():
            self.statistics.add(sample)
            self._watch_reconnects()
            if self._queued - self.taken < self._most:
                self._queued += 1
                self._outbox.put(Queued(self, sample))
            else:
                self.dropped += 1
            if isinstance(sample.payload, JointReading):
                self._watch_stop(sample.payload, sample.host_ns)

    def _watch_reconnects(self) -> None:
        """Note that the driver has connected again; it is counted once."""
        count = self._device.counters.reconnects
        if count > self._reconnects:
            self._log.add(events.DEVICE_BACK, {"device": self.name, "by": "the driver"})
        self._reconnects = count

    def _watch_stop(self, reading: JointReading, host_ns: int) -> None:
        if reading.is_stopped == self._is_stopped:
            return
        self._is_stopped = reading.is_stopped
        name = events.EMERGENCY_STOP if reading.is_stopped else events.EMERGENCY_STOP_RELEASED
        self._log.add(name, {"device": self.name}, host_ns=host_ns)

    def _lose(self, error: Exception) -> None:
        text = str(error) if isinstance(error, CaptureError) else f"{type(error).__name__}: {error}"
        self.trouble = " ".join(f"the device is gone: {text}".split())[:500]
        self._log.add(events.DEVICE_LOST, {"device": self.name, "reason": self.trouble})
        self._device.close()

    def _is_back(self) -> bool:
        """Try to open the device again; return whether this worked."""
        self._before = replace(self.counters(), reconnects=self.counters().reconnects + 1)
        self._device, self._reconnects = self.model.make(self._config.settings), 0
        try:
            self._device.open()
        except Exception:
            self._device.close()
            self._before = replace(self._before, reconnects=self._before.reconnects - 1)
            return False
        if self._over.is_set():
            self._device.stop()
        self.trouble = ""
        self._log.add(events.DEVICE_BACK, {"device": self.name, "by": "opening it again"})
        return True
