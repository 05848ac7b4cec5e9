"""Events of a session: what happened besides samples, on the topic ``/events``."""

from __future__ import annotations

import threading
import time
from collections import Counter, deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any

SESSION_STARTED, SESSION_ENDED = "session_started", "session_ended"
DEVICE_LOST, DEVICE_BACK, DEVICE_ENDED = "device_lost", "device_back", "device_ended"
EMERGENCY_STOP, EMERGENCY_STOP_RELEASED = "emergency_stop", "emergency_stop_released"
ALARM, ALARM_ENDED = "alarm", "alarm_ended"
SAMPLES_DROPPED = "samples_dropped"
"""With ``device`` and ``count``: since the last such event."""
HOOK_STARTED, HOOK_ENDED, HOOK_SAYS = "hook_started", "hook_ended", "hook_says"
EPISODE_START, EPISODE_END = "episode_start", "episode_end"
"""Marks of a person or of the hook; the end may have ``success``: true or false."""
_NOTHING: Mapping[str, Any] = MappingProxyType({})
LATEST = 100
"""Events that are kept for the live page."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SessionEvent:
    """Something that happened."""

    event: str
    """What, such as ``device_lost``."""
    host_ns: int
    """``time.monotonic_ns()``."""
    fields: Mapping[str, Any]
    """More of it: JSON values."""


class EventLog:
    """Takes events from any thread, and hands each on."""

    def __init__(self, send: Callable[[SessionEvent], None]) -> None:
        self.latest: deque[SessionEvent] = deque(maxlen=LATEST)
        self.counts: Counter[str] = Counter()
        self._send = send
        self._lock = threading.Lock()

    def add(
        self, event: str, fields: Mapping[str, Any] = _NOTHING, *, host_ns: int | None = None
    ) -> SessionEvent:
        """Add an event of now, or of ``host_ns``; ``fields`` are JSON values."""
        at = time.monotonic_ns() if host_ns is None else host_ns
        made = SessionEvent(event=event, host_ns=at, fields=fields)
        with self._lock:
            self.latest.append(made)
            self.counts[event] += 1
            self._send(made)
        return made
