"""Recording with its messages on the terminal, for the commands that record."""

# ruff: noqa: PLC0415

from __future__ import annotations

import contextlib
import sys
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING, Protocol

from grasp_factory.cli.printing import print_json, say, show_status
from grasp_factory.core.text_format import count, size_text, table
from grasp_factory.errors import Terminated, UsageError

if TYPE_CHECKING:
    from grasp_factory.apps.session_page.page import SessionPage
    from grasp_factory.capture.devices.base import DeviceModel
    from grasp_factory.capture.session.recorder import SessionRecorder
    from grasp_factory.capture.session.session_config import SessionConfig
    from grasp_factory.capture.session.session_folder import CalibrationFile
    from grasp_factory.capture.session.session_record import RecordedSession

STEP_S = 1.0
"""Seconds between two lines of status on a terminal."""
EACH = 10
"""Without a terminal, every so many steps have a line."""
INTERRUPTED, TERMINATED = "interrupted", "terminated"


@dataclass(frozen=True, slots=True, kw_only=True)
class LiveOptions:
    """What was asked of the live page."""

    is_wanted: bool
    port: int | None

    def __post_init__(self) -> None:
        if self.port is not None and not self.is_wanted:
            raise UsageError("--live-port is the port of the live page: add --live")


class RecordingStage(Protocol):
    """What happens beside a recording."""

    def start(self, recorder: SessionRecorder) -> None:
        """Do what belongs to its start."""

    def finish(self, recorder: SessionRecorder) -> None:
        """Do what belongs to its end."""


def default_folder(config: SessionConfig) -> Path:
    """Return the folder that the settings name, in the present one."""
    return Path(config.folder_name(datetime.now().astimezone()))


def record(
    config: SessionConfig,
    models: Mapping[str, DeviceModel],
    out: Path,
    calibrations: Mapping[str, CalibrationFile],
    *,
    live: LiveOptions,
    quiet: bool,
    as_json: bool,
    stage: RecordingStage | None = None,
) -> RecordedSession:
    """Record until the session ends; print what happens, and at the end what was recorded.

    Ctrl-C is the usual end. SIGTERM ends the session as cleanly, and is raised again.

    Raises:
        Terminated: after SIGTERM.
    """
    from grasp_factory.capture.session.recorder import SessionRecorder

    terminal = _Terminal(quiet=quiet)
    stopped: KeyboardInterrupt | None = None
    with _page(live, terminal) as page:
        with SessionRecorder(config, models, out, calibrations, terminal.alarm) as recorder:
            try:
                if page is not None:
                    page.start(recorder)
                if stage is not None:
                    stage.start(recorder)
                terminal.say(f"Recording {', '.join(config.devices)} to {out}; Ctrl-C ends it")
                while not recorder.wait(STEP_S):
                    terminal.show(recorder)
            except KeyboardInterrupt as why:
                stopped = why
                recorder.ask_to_end(TERMINATED if isinstance(why, Terminated) else INTERRUPTED)
            terminal.clear()
            if stage is not None:
                stage.finish(recorder)
            found = recorder.end("stopped")
    if as_json:
        print_json(found)
    elif not quiet:
        say(recorded_text(out, found))
    if isinstance(stopped, Terminated):
        raise stopped
    return found


@contextlib.contextmanager
def _page(live: LiveOptions, terminal: _Terminal) -> Iterator[SessionPage | None]:
    """Yield the live page, if it was asked for."""
    if not live.is_wanted:
        yield None
        return
    from grasp_factory.apps.session_page.page import SessionPage

    with SessionPage(live.port, tell=terminal.alarm) as page:
        yield page


class _Terminal:
    """Prints lines on stderr; on a terminal, a last line shows the rates."""

    def __init__(self, *, quiet: bool) -> None:
        self._quiet = quiet
        self._is_terminal = sys.stderr.isatty()
        self._steps = 0

    def say(self, text: str) -> None:
        """Print a line, unless it was asked to be quiet."""
        if not self._quiet:
            self.alarm(text)

    def alarm(self, text: str) -> None:
        """Print a line."""
        self.clear()
        say(text, err=True)

    def show(self, recorder: SessionRecorder) -> None:
        """Show the rates; without a terminal, now and then."""
        self._steps += 1
        if self._quiet:
            return
        if self._is_terminal:
            show_status(status_text(recorder))
        elif self._steps % EACH == 0:
            say(status_text(recorder), err=True)

    def clear(self) -> None:
        """Remove the line of status."""
        if self._is_terminal and not self._quiet:
            show_status("")


def status_text(recorder: SessionRecorder) -> str:
    """Return time, rates, drops and speed in one line."""
    from grasp_factory.capture.session.stream_statistics import rate_hz

    monitor = recorder.monitor
    limits = recorder.config.tolerances.window_s
    rates = [
        f"{name} {rate_hz(window.latest(limits)):.4g} Hz"
        for name, window in monitor.windows.items()
    ]
    dropped = sum(station.dropped for station in recorder.stations)
    alarms = [f"{count(len(monitor.book.lasting), 'alarm')}"] if monitor.book.lasting else []
    speed = f"{size_text(monitor.disk.bytes_per_s)}/s"
    return ", ".join(
        [f"{recorder.elapsed_s():.0f} s", *rates, speed, f"{dropped} dropped", *alarms]
    )


def recorded_text(out: Path, found: RecordedSession) -> str:
    """Return what was recorded, as a table and a line."""
    from grasp_factory.capture.session.session_reading import seconds_between

    seconds = seconds_between(found.start, found.end)
    rows = [("device", "samples", "Hz", "longest gap", "lost", "damaged", "dropped")]
    rows += [
        (
            name,
            f"{device.written:,}",
            f"{device.rate_hz:.4g}",
            f"{1e3 * device.longest_gap_s:.1f} ms",
            f"{device.lost:,}",
            f"{device.bad_checksums + device.implausible:,}",
            f"{device.samples - device.written:,}",
        )
        for name, device in found.devices.items()
    ]
    head = f"{out}: {seconds:.1f} s, {size_text(found.bytes)}, ended by {found.ended}"
    alarms = found.events.get("alarm", 0)
    return "\n".join([head, table(rows, range(1, 7)), count(alarms, "alarm")])
