"""The one thread that writes: it takes samples and events from the queue, and flushes the file."""

from __future__ import annotations

import threading
import time
from collections import Counter
from collections.abc import Callable, Iterable
from functools import partial
from queue import Empty

from grasp_factory.capture.samples import CameraFrame
from grasp_factory.capture.session.events import SessionEvent
from grasp_factory.capture.session.messages import MessageEncoder
from grasp_factory.capture.session.session_file import SessionFile
from grasp_factory.capture.session.station import Outbox, Queued
from grasp_factory.capture.session.topic_names import EVENTS, MESSAGES

DISK_FAILED, FAILED = "disk_failed", "recorder_failed"
FLUSH_S = 0.25
"""Seconds between two flushes: what is younger is lost if the process is killed."""


class SessionWriter:
    """Writes until it is ended, or the disk fails.

    Attributes:
        written: samples that are in the file, by device.
        error: what the disk said when it failed, or a bug; then nothing more is written.
    """

    def __init__(
        self,
        file: SessionFile,
        outbox: Outbox,
        offset_ns: int,
        on_error: Callable[[str], None],
    ) -> None:
        """Prepare to write.

        Args:
            file: the started file.
            outbox: the queue.
            offset_ns: epoch minus monotonic time.
            on_error: called once, in the writer's thread, with why nothing more can be written.
        """
        self.written: Counter[str] = Counter()
        self.error: Exception | None = None
        self._file, self._outbox, self._offset_ns = file, outbox, offset_ns
        self._on_error = on_error
        self._encoder = MessageEncoder()
        self._pending: Counter[str] = Counter()
        """Samples in the chunk that is being filled; lost if the disk does not take it."""
        self._is_over = False
        self._thread = threading.Thread(target=self._run, name="writer", daemon=True)

    def start(self, roles: Iterable[str]) -> None:
        """Begin to write samples that have these roles."""
        self._encoder.prepare(roles)
        self._thread.start()

    def end(self) -> None:
        """Write what is queued, and the end of the file."""
        self._is_over = True
        self._outbox.put(None)
        self._thread.join()

    def failure(self, command: str) -> str:
        """Return what failed, and that the user may run a command then."""
        stays = "what was recorded until then stays:"
        if isinstance(self.error, OSError):
            why = self.error.strerror or self.error
            return f"the disk failed ({why}); {stays} free some space, then {command}"
        return f"the recorder failed ({type(self.error).__name__}: {self.error}); {stays} {command}"

    def _run(self) -> None:
        due = time.monotonic() + FLUSH_S
        while True:
            try:
                item = self._outbox.get(timeout=max(0.0, due - time.monotonic()))
            except Empty:
                item = None
            if isinstance(item, Queued):
                item.station.taken += 1
            if item is not None:
                self._guarded(partial(self._write, item))
            if time.monotonic() >= due:
                self._guarded(partial(self._counted, self._file.flush))
                due = time.monotonic() + FLUSH_S
            if self._is_over and self._outbox.empty():
                break
        self._guarded(partial(self._counted, self._file.close))

    def _guarded(self, work: Callable[[], None]) -> None:
        """Do some work, unless some has failed; a thread that ends would lose all in silence."""
        if self.error is not None:
            return
        try:
            work()
        except Exception as error:
            self.error = error
            self._on_error(DISK_FAILED if isinstance(error, OSError) else FAILED)

    def _counted(self, work: Callable[[], None]) -> None:
        """Do some work; if it put the chunk into the file, what was pending is written."""
        before = self._file.position
        try:
            work()
        finally:
            if self._file.position > before:
                self.written.update(self._pending)
                self._pending.clear()

    def _write(self, item: Queued | SessionEvent) -> None:
        if isinstance(item, SessionEvent):
            self._write_event(item)
        else:
            self._write_sample(item)

    def _write_event(self, event: SessionEvent) -> None:
        stamp = event.host_ns + self._offset_ns
        data = self._encoder.text({"event": event.event, "time_ns": stamp, **event.fields})
        add = partial(
            self._file.add_message,
            EVENTS,
            "std_msgs/msg/String",
            {},
            data,
            log_ns=stamp,
            publish_ns=stamp,
            sequence=0,
        )
        self._counted(add)

    def _write_sample(self, item: Queued) -> None:
        station, sample = item.station, item.sample
        stamp = sample.host_ns + self._offset_ns
        try:
            intrinsics = station.intrinsics
            if intrinsics is not None and isinstance(sample.payload, CameraFrame):
                height, width = sample.payload.rgb.shape[:2]
                if (intrinsics.width, intrinsics.height) != (width, height):
                    station.trouble = (
                        f"images are {width} x {height}, its calibration is of"
                        f" {intrinsics.width} x {intrinsics.height}: no camera_info is stored"
                    )
                    intrinsics = None
            messages = list(self._encoder.encode(sample.payload, stamp, station.name, intrinsics))
        except (ValueError, TypeError, AttributeError) as error:
            station.unwritable += 1
            station.trouble = f"samples cannot be stored: {error}"
            return
        metadata = station.metadata | {
            "device_time": str(int(sample.device_ns is not None)),
            "device_sequence": str(int(sample.sequence is not None)),
        }
        for place, (role, data) in enumerate(messages, 1):
            self._pending[station.name] += place == len(messages)
            add = partial(
                self._file.add_message,
                station.topics[role],
                MESSAGES[role],
                metadata,
                data,
                log_ns=stamp,
                publish_ns=stamp if sample.device_ns is None else sample.device_ns,
                sequence=sample.sequence or 0,
            )
            self._counted(add)
