"""The contract of simulated devices, and those that send their track in time."""

from __future__ import annotations

import time
from abc import ABC, abstractmethod
from collections.abc import Mapping
from threading import Event, Thread
from typing import Any, Generic, Self

from grasp_factory.capture.samples import Payload_co
from grasp_factory.capture.simulators.faults import NO_FAULTS, Faults
from grasp_factory.capture.simulators.tracks import DeviceTrack
from grasp_factory.core.episode import Episode

_NS = 10**9


class SimulatedDevice(ABC, Generic[Payload_co]):
    """A device that is not there: a driver reads from it what an episode recorded.

    Use it in ``with``; call ``play`` when the driver is open.

    Args:
        episode: the episode; ``noisy`` gives it the noise of sensors.
        rate_hz: samples per second; 0 for those of the episode.
        speed: how much faster than the attempt it plays.
        repeats: how often it plays the episode.
        faults: what goes wrong.
    """

    is_live = True
    """Whether it may go away and come back; false for a file that is played."""

    def __init__(
        self,
        episode: Episode,
        *,
        rate_hz: float = 0.0,
        speed: float = 1.0,
        repeats: int = 1,
        faults: Faults = NO_FAULTS,
    ) -> None:
        self.faults, self.speed, self.repeats = faults, speed, repeats
        self.track = self.track_of(episode, rate_hz)
        """What it plays, before the resolution of the protocol."""
        self.sent: list[int] = []
        """Places in the track of the samples that it sent clean, in order."""
        self.ended = Event()
        """Set when it has sent everything."""

    @property
    @abstractmethod
    def settings(self) -> Mapping[str, Any]:
        """The settings with which the driver finds it."""

    @property
    @abstractmethod
    def resolution(self) -> float:
        """Largest difference between a value that is sent and the track's, in its unit."""

    @abstractmethod
    def track_of(self, episode: Episode, rate_hz: float) -> DeviceTrack[Payload_co]:
        """Return what to play."""

    @abstractmethod
    def plug(self) -> None:
        """Bring the device, or bring it back to the same place."""

    @abstractmethod
    def unplug(self) -> None:
        """Take the device away."""

    @abstractmethod
    def play(self) -> None:
        """Begin to send. A device that is asked for its stream begins by itself."""

    def __enter__(self) -> Self:
        self.plug()
        return self

    def __exit__(self, *error: object) -> None:
        self.unplug()


class SimulatedSender(SimulatedDevice[Payload_co]):
    """A device whose thread sends each sample when it is due; see ``SimulatedDevice``."""

    def __init__(self, episode: Episode, **playing: Any) -> None:
        super().__init__(episode, **playing)
        self._leave, self._start = Event(), Event()
        self._thread = Thread(target=self._run, name=type(self).__name__, daemon=True)

    @abstractmethod
    def send(self, place: int, number: int, device_ns: int) -> bool:
        """Send a sample; return whether it went out clean.

        Args:
            place: its place in the track.
            number: the device's own count of it.
            device_ns: the device's time.
        """

    def flush(self) -> None:
        """Send what was held back."""

    def is_lost(self) -> bool:
        """Return whether the next sample is counted, but not sent."""
        return False

    def play(self) -> None:
        """See ``SimulatedDevice.play``."""
        self._start.set()

    def __enter__(self) -> Self:
        super().__enter__()
        self._thread.start()
        return self

    def __exit__(self, *error: object) -> None:
        self._leave.set()
        self._start.set()
        self._thread.join()
        super().__exit__(*error)

    def _run(self) -> None:
        self._start.wait()
        times = (self.track.times - self.track.times[0]) / self.speed
        period = times[-1] * len(times) / max(len(times) - 1, 1)
        begin, number = time.monotonic_ns(), self.faults.counter_start
        flushed = 0.0
        for turn in range(self.repeats):
            for place, offset in enumerate(times):
                due = turn * period + float(offset)
                if self._is_left(begin + int(due * _NS)):
                    return
                ticks = due * self.speed * (1.0 + self.faults.clock_ppm * 1e-6)
                if not self.is_lost() and self.send(place, number, int(ticks * _NS)):
                    self.sent.append(place)
                number += 1
                if due - flushed >= self.faults.batch_s:
                    flushed = due
                    self.flush()
        self.flush()
        self.ended.set()

    def _is_left(self, due_ns: int) -> bool:
        """Wait until an instant; return whether the device shall end."""
        left = (due_ns - time.monotonic_ns()) / _NS
        return self._leave.wait(left) if left > 0.0 else self._leave.is_set()
