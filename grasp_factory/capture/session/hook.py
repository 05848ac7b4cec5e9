"""The hook: a command of the user that moves the robot while a session records."""

from __future__ import annotations

import contextlib
import json
import math
import os
import re
import signal
import subprocess
import threading
from collections.abc import Sequence
from typing import IO, Any

from grasp_factory.capture.session import events
from grasp_factory.capture.session.events import EventLog
from grasp_factory.core.json_text import check_depth
from grasp_factory.errors import CaptureError, ConfigError

PATIENCE_S = 5.0
"""Seconds that the hook has to end after Ctrl-C, and again after SIGTERM."""
LONGEST_LINE = 4096
MOST_LINES = 10_000
"""Lines of output that become events; a hook that talks without end must not fill the disk."""
_EVENT = re.compile(r"[a-z][a-z0-9_]{0,63}")
_OWN = {"event", "time_ns", "host_ns", "by"}


class MotionHook:
    """Runs the command. Lines that it prints become events.

    A line that is a JSON object with the key ``event`` is an event of that name, such as
    ``{"event": "episode_end", "success": true}``. Its stdin is a pipe that ends if the recorder is
    gone: a robot's program should watch it, and stop.
    """

    def __init__(self, command: Sequence[str], log: EventLog) -> None:
        """Start it.

        Raises:
            CaptureError: if it cannot be started.
        """
        self._log = log
        try:
            self._process = subprocess.Popen(
                list(command),
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                start_new_session=True,
            )
        except OSError as error:
            raise CaptureError(f"the hook {command[0]!r} cannot run: {error.strerror}") from None
        log.add(events.HOOK_STARTED, {"command": list(command)})
        assert self._process.stdout is not None
        self._thread = threading.Thread(
            target=self._listen, args=(self._process.stdout,), name="hook", daemon=True
        )
        self._thread.start()

    def result(self) -> int | None:
        """Return the exit code; None while it runs."""
        return self._process.poll()

    def stop(self) -> None:
        """Ask it to end as Ctrl-C does, then harder; return when it has ended."""
        for number in (signal.SIGINT, signal.SIGTERM, signal.SIGKILL):
            if self._process.poll() is not None:
                break
            with contextlib.suppress(ProcessLookupError):
                os.killpg(self._process.pid, number)
            with contextlib.suppress(subprocess.TimeoutExpired):
                self._process.wait(PATIENCE_S)
        code = self._process.wait()
        self._thread.join(PATIENCE_S)
        if self._process.stdin is not None:
            with contextlib.suppress(OSError):
                self._process.stdin.close()
        self._log.add(events.HOOK_ENDED, {"code": code})

    def _listen(self, output: IO[bytes]) -> None:
        lines = 0
        with output:
            while line := output.readline(LONGEST_LINE):
                lines += 1
                if lines <= MOST_LINES:
                    self._note(line.decode("utf-8", "replace").strip())

    def _note(self, line: str) -> None:
        found = _parsed(line)
        if found is None:
            if line:
                self._log.add(events.HOOK_SAYS, {"text": line})
            return
        more = {key: value for key, value in found.items() if key not in _OWN}
        self._log.add(found["event"], more | {"by": "hook"})


def _parsed(line: str) -> dict[str, Any] | None:
    """Return the event in a line; None if there is no event in it."""
    try:
        found = json.loads(line, parse_constant=lambda name: None, parse_float=_finite)
        check_depth("an event", found)
        json.dumps(found, ensure_ascii=False).encode()  # fails for half a surrogate pair
    except (ValueError, RecursionError, ConfigError):
        return None
    if not isinstance(found, dict) or not isinstance(name := found.get("event"), str):
        return None
    is_event = _EVENT.fullmatch(name) and all(key.isidentifier() for key in found)
    return found if is_event else None


def _finite(text: str) -> float | None:
    """Return a number of JSON; None for one that no float holds, such as 1e999."""
    value = float(text)
    return value if math.isfinite(value) else None
