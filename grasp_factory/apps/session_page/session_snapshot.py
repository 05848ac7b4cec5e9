"""How a session is at this moment, as plain values for its page."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np

from grasp_factory.capture.samples import CameraFrame, DeviceKind, TactileReading
from grasp_factory.capture.session.events import (
    ALARM,
    ALARM_ENDED,
    SAMPLES_DROPPED,
    SessionEvent,
)
from grasp_factory.capture.session.recorder import SessionRecorder
from grasp_factory.capture.session.session_record import utc
from grasp_factory.capture.session.station import DeviceStation
from grasp_factory.capture.session.stream_statistics import StreamWindow, rate_hz
from grasp_factory.core.serialization import to_plain
from grasp_factory.core.shown_units import SHOWN_UNITS

RECORDING, ENDED = "recording", "ended"
MOST_EVENTS = 12
SHOWN_ELSEWHERE = {ALARM, ALARM_ENDED, SAMPLES_DROPPED}
_WIDTH = SHOWN_UNITS["gripper_width"]
GROUPS: dict[DeviceKind, tuple[tuple[str, str, int, int, float], ...]] = {
    DeviceKind.IMU: (
        ("specific force", "m/s²", 0, 3, 1.0),
        ("angular velocity", "rad/s", 3, 6, 1.0),
    ),
    DeviceKind.FORCE_TORQUE: (("force", "N", 0, 3, 1.0), ("torque", "N m", 3, 6, 1.0)),
    DeviceKind.JOINTS: (
        ("joint positions", "rad", 0, -1, 1.0),
        ("gripper width", _WIDTH.unit, -1, 64, _WIDTH.factor),
    ),
}
"""Curves of a kind of device: title, units, which of its values, and their factor."""


def snapshot(recorder: SessionRecorder) -> dict[str, Any]:
    """Return the state of a session; docs/guides/capture.md describes the page."""
    config, monitor = recorder.config, recorder.monitor
    return {
        "phase": ENDED if recorder.why else RECORDING,
        "why": recorder.why,
        "name": recorder.out.name,
        "path": str(Path(recorder.out).absolute()),
        "operator": config.operator,
        "task": config.task,
        "scenario": config.scenario,
        "started": utc(recorder.started_ns + recorder.offset_ns),
        "elapsed": round(recorder.elapsed_s(), 2),
        "duration_s": config.duration_s,
        "devices": [_device(station, recorder) for station in recorder.stations],
        "alarms": [to_plain(alarm) for alarm in monitor.book.lasting.values()],
        "past_alarms": [to_plain(alarm) for alarm in reversed(monitor.book.past)],
        "events": _events(recorder),
        "disk": {
            "free": monitor.disk.free,
            "bytes_per_s": round(monitor.disk.bytes_per_s),
        },
    }


def _device(station: DeviceStation, recorder: SessionRecorder) -> dict[str, Any]:
    window = recorder.monitor.windows.get(station.name)
    counters, latest = station.counters(), station.statistics.latest
    payload = latest.payload if latest else None
    return {
        "name": station.name,
        "driver": station.model.name,
        "kind": station.model.kind.name.lower(),
        "samples": station.statistics.total,
        "dropped": station.dropped,
        "lost": counters.lost,
        "damaged": counters.bad_checksums + counters.implausible,
        "reconnects": counters.reconnects,
        "images": _images(payload),
        **_recent(window, recorder.config.tolerances.window_s),
    }


def _images(payload: Any) -> list[str]:
    if isinstance(payload, CameraFrame):
        return ["rgb", "depth"] if payload.depth is not None else ["rgb"]
    return ["taxels"] if isinstance(payload, TactileReading) else []


def _recent(window: StreamWindow | None, seconds: float) -> dict[str, Any]:
    """Return what happened lately: rate, longest gap, how full the queue is."""
    if window is None:
        return {"expected_hz": None, "rate_hz": None, "longest_gap_s": None, "queue": 0.0}
    buckets = window.latest(seconds)
    gap = max((b.longest_gap_ns for b in buckets), default=0) / 1e9
    return {
        "expected_hz": window.expected_hz,
        "rate_hz": round(rate_hz(buckets), 3),
        "longest_gap_s": round(max(gap, window.silent_s if window.silent_s > gap else 0.0), 4),
        "queue": round(window.queue, 3),
    }


def _events(recorder: SessionRecorder) -> list[dict[str, Any]]:
    """Return the latest events that the page does not show elsewhere, the newest first."""
    latest = [one for one in list(recorder.log.latest) if one.event not in SHOWN_ELSEWHERE]
    return [_event(one, recorder.started_ns) for one in reversed(latest[-MOST_EVENTS:])]


def _event(event: SessionEvent, started_ns: int) -> dict[str, Any]:
    text = ", ".join(f"{key}: {_words(value)}" for key, value in event.fields.items())
    at = round((event.host_ns - started_ns) / 1e9, 2)
    return {"event": event.event, "at": at, "text": text[:300]}


def _words(value: Any) -> str:
    if isinstance(value, bool):
        return "yes" if value else "no"
    return " ".join(map(str, value)) if isinstance(value, list) else str(value)


def curves(recorder: SessionRecorder) -> list[dict[str, Any]]:
    """Return curves of the latest seconds: of IMUs, force-torque sensors and joints."""
    found = []
    for station in recorder.stations:
        points = station.statistics.latest_curve()
        times = [round((at - recorder.started_ns) / 1e9, 3) for at, _ in points]
        for title, units, first, stop, factor in GROUPS.get(station.model.kind, ()):
            rows = [[factor * value for value in values[first:stop]] for _, values in points]
            width = min(map(len, rows), default=0)
            series = np.array([row[:width] for row in rows]).T.tolist() if width else []
            found.append(
                {
                    "device": station.name,
                    "title": title,
                    "units": units,
                    "times": times,
                    "series": [[_rounded(value) for value in one] for one in series],
                }
            )
    return found


def _rounded(value: float) -> float | None:
    return float(f"{value:.5g}") if math.isfinite(value) else None
