"""Simulated devices that are files, which their driver plays by itself."""

from __future__ import annotations

import shutil
import tempfile
from abc import abstractmethod
from pathlib import Path
from typing import Any

from grasp_factory.capture.samples import Payload_co
from grasp_factory.capture.simulators.base import SimulatedDevice
from grasp_factory.core.episode import Episode


class SimulatedRecording(SimulatedDevice[Payload_co]):
    """A file of an episode in a folder of its own; see ``SimulatedDevice`` for the arguments."""

    is_live = False

    def __init__(self, episode: Episode, **playing: Any) -> None:
        super().__init__(episode, **playing)
        self.sent = list(range(len(self.track.payloads))) * self.repeats
        self._folder: Path | None = None
        self._name = Path(tempfile.gettempdir()) / "not-there"

    @abstractmethod
    def write(self, path: Path) -> None:
        """Write the file."""

    @property
    def path(self) -> Path:
        """The file; it is there while the device is."""
        return self._name if self._folder is None else self._folder / "recording"

    def plug(self) -> None:
        """See ``SimulatedDevice.plug``."""
        if self._folder is None:
            self._folder = Path(tempfile.mkdtemp(prefix="grasp-factory-recording-"))
            self.write(self.path)
            self.ended.set()

    def unplug(self) -> None:
        """See ``SimulatedDevice.unplug``."""
        folder, self._folder = self._folder, None
        if folder is not None:
            shutil.rmtree(folder, ignore_errors=True)

    def play(self) -> None:
        """See ``SimulatedDevice.play``."""
