"""The recorder: opens the devices, makes the folder, starts the threads, and ends all of it."""

from __future__ import annotations

import contextlib
import os
import threading
import time
from collections.abc import Callable, Mapping
from dataclasses import asdict, fields, replace
from pathlib import Path
from queue import SimpleQueue
from types import TracebackType
from typing import NoReturn, Self

from grasp_factory import __version__
from grasp_factory.capture.devices.base import DeviceModel
from grasp_factory.capture.samples import DeviceKind
from grasp_factory.capture.session import events
from grasp_factory.capture.session.camera_info import camera_intrinsics
from grasp_factory.capture.session.clock_state import clock_state
from grasp_factory.capture.session.events import EventLog, SessionEvent
from grasp_factory.capture.session.hook import MotionHook
from grasp_factory.capture.session.monitor import SessionMonitor
from grasp_factory.capture.session.session_config import SessionConfig
from grasp_factory.capture.session.session_file import SessionFile
from grasp_factory.capture.session.session_folder import CalibrationFile, SessionFolder
from grasp_factory.capture.session.session_record import (
    VERSION,
    RecordedDevice,
    RecordedSession,
    utc,
)
from grasp_factory.capture.session.session_writer import SessionWriter
from grasp_factory.capture.session.station import DeviceStation, Outbox
from grasp_factory.capture.session.topic_names import topics_of
from grasp_factory.errors import CaptureError, StoreError

DURATION, HOOK, DEVICES_ENDED = "duration", "hook", "devices_ended"
DISK_FULL = "disk_full"


class SessionRecorder:
    """Records one session inside of a ``with`` block.

    The block waits with ``wait``, and may ``end`` with a reason. What is still open when the block
    is left ends with it.

    Attributes:
        config: the settings.
        log: takes events, also marks of a person.
        monitor: the latest statistics and alarms.
        stations: the devices.
        started_ns: host time of the start.
        offset_ns: the epoch's time minus host time.
        record: what was recorded; None until the session has ended.
    """

    def __init__(
        self,
        config: SessionConfig,
        models: Mapping[str, DeviceModel],
        out: Path,
        calibrations: Mapping[str, CalibrationFile],
        tell: Callable[[str], None],
    ) -> None:
        """Prepare; nothing is opened before the block.

        Args:
            config: the settings.
            models: the row of the table of devices of each device.
            out: the folder to create.
            calibrations: the calibration file of each device that has one.
            tell: shows the user a line about an alarm; any thread may call it.

        Raises:
            ConfigError: if the topics of devices collide.
            CaptureError: if a calibration cannot be used.
        """
        self.config, self.out = config, out
        self.record: RecordedSession | None = None
        self._calibrations, self._tell = calibrations, tell
        self._outbox: Outbox = SimpleQueue()
        self.log = EventLog(self._send)
        topics = topics_of(config, models)
        intrinsics = {
            name: camera_intrinsics(file.content, file.path)
            for name, file in calibrations.items()
            if models[name].kind is DeviceKind.CAMERA
        }
        self.stations = [
            DeviceStation(
                name,
                device,
                models[name],
                topics[name],
                intrinsics.get(name),
                clipped=config.tolerances.clipped,
                queue_s=config.queue_s,
                outbox=self._outbox,
                log=self.log,
            )
            for name, device in config.devices.items()
        ]
        self._why = ""
        self._over = threading.Event()
        self._hook: MotionHook | None = None
        self._lock = threading.Lock()

    def __enter__(self) -> Self:
        """Open the devices and begin to record.

        Raises:
            CaptureError: if a device or the hook does not start, or the disk has no room.
            UsageError: if the folder cannot be made.
            StoreError: if the disk fails.
        """
        self._open_devices()
        try:
            self._begin()
        except BaseException:
            for station in self.stations:
                station.ask_to_stop()
                station.end()
            raise
        try:
            if self.config.hook:
                self._hook = MotionHook(self.config.hook, self.log)
        except BaseException as error:
            self.end(f"the hook failed: {error}")
            raise
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """End the session if it has not ended."""
        self.end("stopped" if error is None else f"an error: {kind.__name__ if kind else ''}")

    def wait(self, seconds: float) -> bool:
        """Wait for up to so many seconds; return whether the session should end now."""
        limit = self.config.duration_s
        deadline = time.monotonic() + seconds
        while not self._over.is_set():
            now = time.monotonic()
            if limit is not None and self.elapsed_s() >= limit:
                self.ask_to_end(DURATION)
            elif self._hook is not None and limit is None and self._hook.result() is not None:
                self.ask_to_end(HOOK)
            elif not any(station.is_running for station in self.stations):
                self.ask_to_end(DEVICES_ENDED)
            elif now >= deadline:
                return False
            else:
                left = limit - self.elapsed_s() if limit is not None else seconds
                self._over.wait(max(0.0, min(0.1, left, deadline - now)))
        return True

    def elapsed_s(self) -> float:
        """Return the seconds since the start."""
        return (time.monotonic_ns() - self.started_ns) / 1e9

    @property
    def why(self) -> str:
        """Why the session ends; empty while it goes on."""
        return self._why

    def ask_to_end(self, why: str) -> None:
        """Let ``wait`` return; the first reason counts. Any thread may call this."""
        with self._lock:
            if not self._why:
                self._why = why
        self._over.set()

    def end(self, why: str) -> RecordedSession:
        """End: the hook first, so that the robot's last motion is recorded; then devices and file.

        Args:
            why: the reason, unless there is one already.
        """
        self.ask_to_end(why)
        if self.record is not None:
            return self.record
        if self._hook is not None:
            self._hook.stop()
        for station in self.stations:
            station.ask_to_stop()
        for station in self.stations:
            if not station.end():
                self.log.add(
                    events.DEVICE_LOST, {"device": station.name, "reason": "it does not stop"}
                )
        self.monitor.end()
        self.log.add(events.SESSION_ENDED, {"reason": self._why})
        self._writer.end()
        os.close(self._descriptor)
        self.record = self._recorded()
        if self._writer.error is not None:
            self._say_what_stays(self.record)
        self._folder.write_record(self.record)
        return self.record

    def _say_what_stays(self, record: RecordedSession) -> NoReturn:
        with contextlib.suppress(StoreError):  # on a full disk it may not fit
            self._folder.write_record(record)
        what = self._folder.path
        how = self._writer.failure(f"run grasp-factory capture recover {what}")
        raise CaptureError(f"{what}: {how}")

    def _open_devices(self) -> None:
        opened: list[DeviceStation] = []
        try:
            for station in self.stations:
                opened.append(station)
                station.open()
        except BaseException:
            for station in opened:
                station.ask_to_stop()
                station.end()
            raise

    def _begin(self) -> None:
        self._folder = SessionFolder.create(self.out, self.config, self._calibrations)
        self.started_ns, self.offset_ns = host_clock()
        self._clock = clock_state()
        self._descriptor = self._folder.open_data()
        self._file = SessionFile(self._descriptor, self.config.compression)
        self._folder.write_head(self._file, self.started_ns, self.offset_ns)
        self.monitor = SessionMonitor(
            self.stations,
            self._file,
            self._descriptor,
            limits=self.config.tolerances,
            reserve=round(1e6 * self.config.disk_reserve_mb),
            log=self.log,
            tell=self._tell,
            on_full_disk=lambda: self.ask_to_end(DISK_FULL),
        )
        self._writer = SessionWriter(self._file, self._outbox, self.offset_ns, self.ask_to_end)
        self.log.add(events.SESSION_STARTED, {"devices": list(self.config.devices)})
        self._writer.start({role for station in self.stations for role in station.topics})
        for station in self.stations:
            station.start()
        self.monitor.start()

    def _send(self, event: SessionEvent) -> None:
        self._outbox.put(event)
        if event.event == events.EMERGENCY_STOP:
            self.ask_to_end(events.EMERGENCY_STOP)

    def _recorded(self) -> RecordedSession:
        return RecordedSession(
            version=VERSION,
            start=utc(self.started_ns + self.offset_ns),
            end=utc(time.monotonic_ns() + self.offset_ns),
            ended=self._why,
            ended_cleanly=self._writer.error is None,
            offset_ns=self.offset_ns,
            clock=self._clock,
            bytes=self._file.position,
            devices={station.name: self._device_record(station) for station in self.stations},
            events=dict(self.log.counts),
            made_with=__version__,
        )

    def _device_record(self, station: DeviceStation) -> RecordedDevice:
        counted = RecordedDevice(
            driver=station.model.name,
            kind=station.model.kind.name.lower(),
            samples=station.statistics.total,
            written=self._writer.written.get(station.name, 0),
            dropped=station.dropped,
            unwritable=station.unwritable,
            rate_hz=round(station.statistics.mean_rate_hz(), 3),
            longest_gap_s=round(station.statistics.longest_gap_ns / 1e9, 6),
        )
        known = {f.name for f in fields(counted)} - {"samples"}
        seen = asdict(station.counters())
        return replace(counted, **{name: seen[name] for name in known & seen.keys()})


def host_clock() -> tuple[int, int]:
    """Return ``time.monotonic_ns()``, and what to add to it for ns since the epoch.

    The wall clock is read between two readings of the other one; the closest of some pairs counts.
    """
    pairs = []
    for _ in range(5):
        before, wall, after = time.monotonic_ns(), time.time_ns(), time.monotonic_ns()
        pairs.append((after - before, before, wall - (before + after) // 2))
    _, now, offset = min(pairs)
    return now, offset
