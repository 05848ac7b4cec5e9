"""The watch over a session: looks at all streams once a second, and raises alarms."""

from __future__ import annotations

import os
import threading
import time
from collections.abc import Callable, Mapping, Sequence

from grasp_factory.capture.session import events
from grasp_factory.capture.session.checks import (
    DiskWindow,
    disk_finding,
    queue_findings,
    stream_findings,
)
from grasp_factory.capture.session.events import EventLog
from grasp_factory.capture.session.session_file import SessionFile
from grasp_factory.capture.session.station import DeviceStation
from grasp_factory.capture.session.stream_statistics import StreamWindow
from grasp_factory.capture.session.tolerances import Tolerances
from grasp_factory.core.alarm_book import Alarm, AlarmBook

STEP_S = 1.0
"""Seconds between two looks."""


class SessionMonitor:
    """Looks, from ``start`` to ``end``, in a thread of its own.

    Attributes:
        book: the alarms.
        windows: what was seen last, by device.
        disk: the disk then.
        rate: bytes per second that the session wrote lately.
    """

    def __init__(
        self,
        stations: Sequence[DeviceStation],
        file: SessionFile,
        descriptor: int,
        *,
        limits: Tolerances,
        reserve: int,
        log: EventLog,
        tell: Callable[[str], None],
        on_full_disk: Callable[[], None],
    ) -> None:
        """Prepare to watch.

        Args:
            stations: the devices.
            file: the file that is written.
            descriptor: the open file, to find out about its disk.
            limits: from when on something is a fault.
            reserve: bytes that must stay free.
            log: takes alarms as events.
            tell: shows the user a line.
            on_full_disk: called when less than the reserve is free.
        """
        self.book = AlarmBook()
        self.windows: Mapping[str, StreamWindow] = {}
        self.disk = DiskWindow(
            free=free_bytes(descriptor), reserve=reserve, bytes_per_s=0.0, sync_s=0.0
        )
        self._stations, self._file, self._descriptor = stations, file, descriptor
        self._limits, self._log, self._tell = limits, log, tell
        self._on_full_disk = on_full_disk
        self._started = self._looked = time.monotonic()
        self._bytes = file.position
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._run, name="monitor", daemon=True)

    def start(self) -> None:
        """Begin to watch."""
        self._thread.start()

    def end(self) -> None:
        """Stop watching."""
        self._over.set()
        if self._thread.is_alive():
            self._thread.join()
            self.look()

    def look(self) -> None:
        """Look once: update the windows and the alarms."""
        now, now_ns = time.monotonic(), time.monotonic_ns()
        self.windows = {station.name: station.look(now_ns) for station in self._stations}
        self.disk = self._look_at_disk(now)
        for name, window in self.windows.items():
            if dropped := window.buckets[-1].dropped:
                self._log.add(events.SAMPLES_DROPPED, {"device": name, "count": dropped})
        windows = self.windows.values()
        found = stream_findings(windows, self._limits) + queue_findings(windows, self._limits)
        if full := disk_finding(self.disk, self._limits):
            found.append(full)
        before = dict(self.book.lasting)
        for alarm in self.book.update(found, now - self._started):
            self._tell(f"alarm ({alarm.kind}): {_named(alarm)}{alarm.text}")
        for key, alarm in self.book.lasting.items():
            if key not in before:
                self._log.add(events.ALARM, _fields(alarm) | {"text": alarm.text})
        for key, alarm in before.items():
            if key not in self.book.lasting:
                self._log.add(events.ALARM_ENDED, _fields(alarm))
        if self.disk.free < self.disk.reserve:
            self._on_full_disk()

    def _run(self) -> None:
        while not self._over.wait(STEP_S):
            self.look()

    def _look_at_disk(self, now: float) -> DiskWindow:
        written, span = self._file.position, max(now - self._looked, 1e-3)
        speed = (written - self._bytes) / span
        self._bytes, self._looked = written, now
        return DiskWindow(
            free=free_bytes(self._descriptor),
            reserve=self.disk.reserve,
            bytes_per_s=max(speed, 0.8 * self.disk.bytes_per_s),
            sync_s=self._file.sync.waiting_s(),
        )


def free_bytes(descriptor: int) -> int:
    """Return the bytes that are free on the disk of an open file."""
    found = os.fstatvfs(descriptor)
    return found.f_bavail * found.f_frsize


def _fields(alarm: Alarm) -> dict[str, str]:
    return {"kind": alarm.kind} | ({"device": alarm.source} if alarm.source else {})


def _named(alarm: Alarm) -> str:
    return f"{alarm.source}: " if alarm.source else ""
