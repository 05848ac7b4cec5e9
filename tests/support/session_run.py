"""A real `grasp-factory capture run` process with ticking devices, for tests."""

from __future__ import annotations

import contextlib
import json
import os
import re
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import pytest
import yaml

PATIENCE_S = 60.0
IMU = {"driver": "ticking_imu", "rate_hz": 200, "settings": {"rate_hz": 200}}
CAMERA = {"driver": "ticking_camera", "rate_hz": 30, "settings": {"rate_hz": 30}}
WRENCH = {"driver": "ticking_wrench", "rate_hz": 500, "settings": {"rate_hz": 500}}
ARM = {"driver": "ticking_arm", "rate_hz": 100, "settings": {"rate_hz": 100}}


def device(base: Mapping[str, Any], **settings: Any) -> dict[str, Any]:
    """Return a device with other settings of its driver."""
    return {**base, "settings": {**base["settings"], **settings}}


class SessionRun:
    """A recorder in a process of its own. Its output goes to files, lest a pipe fill up."""

    def __init__(self, process: subprocess.Popen[str], said: Path, out: Path) -> None:
        self.process, self.out = process, out
        self._said = said

    @property
    def stdout(self) -> str:
        return (self._said / "stdout").read_text()

    @property
    def stderr(self) -> str:
        return (self._said / "stderr").read_text()

    @property
    def url(self) -> str:
        """The address of the live page that it printed, with the token."""
        return str(self.until(lambda: re.search(r"http://\S+", self.stderr)).group())

    @property
    def data(self) -> Path:
        return self.out / "session.mcap"

    def until(self, condition: Callable[[], Any]) -> Any:
        """Wait until a condition holds; return its value."""
        deadline = time.monotonic() + PATIENCE_S
        while True:
            with contextlib.suppress(OSError):
                if found := condition():
                    return found
            if time.monotonic() > deadline:
                pytest.fail(f"waited {PATIENCE_S:g} s in vain; the recorder says: {self.stderr}")
            time.sleep(0.02)

    def until_recorded(self, size: int = 20_000) -> None:
        """Wait until so many bytes are in the file."""
        self.until(lambda: self.data.stat().st_size > size)

    def wait(self) -> int:
        """Wait for its end; return the exit code."""
        return self.process.wait(PATIENCE_S)

    def stop(self, number: signal.Signals = signal.SIGINT) -> int:
        """Send it a signal; return the exit code."""
        self.process.send_signal(number)
        return self.wait()

    def record(self) -> dict[str, Any]:
        """Return session.json."""
        found: dict[str, Any] = json.loads((self.out / "session.json").read_text())
        return found


@contextlib.contextmanager
def recording(
    folder: Path,
    devices: Mapping[str, Any],
    *options: object,
    **settings: Any,
) -> Iterator[SessionRun]:
    """Record a session in ``folder / "s"`` until the block ends."""
    file = folder / "session.yaml"
    file.write_text(yaml.safe_dump({"devices": dict(devices), **settings}))
    out = folder / "s"
    command: Sequence[str] = (
        *(sys.executable, "-m", "support.ticking_devices", "capture", "run", str(file)),
        *("--out", str(out), *map(str, options)),
    )
    with (
        (folder / "stdout").open("w") as stdout,
        (folder / "stderr").open("w") as stderr,
        subprocess.Popen(
            command,
            stdout=stdout,
            stderr=stderr,
            text=True,
            start_new_session=True,
            env={**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, sys.path))},
        ) as process,
    ):
        try:
            yield SessionRun(process, folder, out)
        finally:
            with contextlib.suppress(ProcessLookupError):
                os.killpg(process.pid, signal.SIGKILL)
