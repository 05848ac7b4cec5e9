"""A simulated serial device: the far end of a pseudo-terminal, and packets that may be spoilt."""

from __future__ import annotations

import os
import pty
import shutil
import tempfile
import time
import tty
from abc import abstractmethod
from collections.abc import Callable, Mapping
from pathlib import Path
from threading import Lock
from typing import Any

from grasp_factory.capture.samples import Payload_co
from grasp_factory.capture.simulators.base import SimulatedSender
from grasp_factory.capture.simulators.faults import NO_FAULTS, Faults, Spoiler
from grasp_factory.core.episode import Episode

_MOST_BYTES = 4096
_RETRY_S = 0.001


class PtyLine:
    """A pseudo-terminal whose near end has a name that stays when it is plugged in again."""

    def __init__(self) -> None:
        self._folder = Path(tempfile.mkdtemp(prefix="grasp-factory-port-"))
        self.path = self._folder / "port"
        self._ends: tuple[int, int] | None = None
        """Far and near; the near one is held open, or the far one would see a hang-up."""
        self._lock = Lock()
        """A thread may unplug what another one writes to."""

    def plug(self) -> None:
        """Bring the port back."""
        with self._lock:
            if self._ends is not None:
                return
            far, near = self._ends = pty.openpty()
            tty.setraw(near)
            os.set_blocking(far, False)
            self.path.symlink_to(os.ttyname(near))

    def unplug(self) -> None:
        """Take the port away: a reader gets an error."""
        with self._lock:
            ends, self._ends = self._ends, None
            for end in ends or ():
                os.close(end)
            self.path.unlink(missing_ok=True)

    def close(self) -> None:
        """Take the port away for good."""
        self.unplug()
        shutil.rmtree(self._folder, ignore_errors=True)

    def write(self, data: bytes, is_left: Callable[[], bool]) -> bool:
        """Send bytes as fast as they are read; return whether all went out.

        Args:
            data: the bytes.
            is_left: returns whether to give up, when the reader takes nothing.
        """
        while data and not is_left():
            with self._lock:
                if self._ends is None:
                    return False
                try:
                    data = data[os.write(self._ends[0], data) :]
                    continue
                except BlockingIOError:
                    pass
            time.sleep(_RETRY_S)
        return not data

    def read(self, timeout_s: float) -> bytes:
        """Return what the driver sent; nothing after the timeout."""
        with self._lock:
            if self._ends is not None:
                try:
                    return os.read(self._ends[0], _MOST_BYTES)
                except BlockingIOError:
                    pass
        time.sleep(timeout_s)
        return b""


class SimulatedSerialDevice(SimulatedSender[Payload_co]):
    """Sends packets over a pseudo-terminal; see ``SimulatedDevice`` for the arguments."""

    def __init__(self, episode: Episode, *, faults: Faults = NO_FAULTS, **playing: Any) -> None:
        super().__init__(episode, faults=faults, **playing)
        self._line, self._spoiler, self._held = PtyLine(), Spoiler(faults), b""

    @abstractmethod
    def packet(self, payload: Any, number: int, device_ns: int) -> bytes:
        """Return the packet of a payload."""

    @property
    def settings(self) -> Mapping[str, Any]:
        """See ``SimulatedDevice.settings``."""
        return {"port": str(self._line.path), "is_paced": False}

    def is_lost(self) -> bool:
        """See ``SimulatedSender.is_lost``."""
        return self._spoiler.is_lost()

    def send(self, place: int, number: int, device_ns: int) -> bool:
        """See ``SimulatedSender.send``."""
        packet = self.packet(self.track.payloads[place], number, device_ns)
        spoilt = self._spoiler.spoilt(packet)
        if self.faults.batch_s:
            self._held += spoilt.data
            return spoilt.is_clean
        return self._line.write(spoilt.data, self._leave.is_set) and spoilt.is_clean

    def flush(self) -> None:
        """See ``SimulatedSender.flush``."""
        held, self._held = self._held, b""
        self._line.write(held, self._leave.is_set)

    def plug(self) -> None:
        """See ``SimulatedDevice.plug``."""
        self._line.plug()

    def unplug(self) -> None:
        """See ``SimulatedDevice.unplug``."""
        self._line.unplug()

    def __exit__(self, *error: object) -> None:
        super().__exit__(*error)
        self._line.close()
