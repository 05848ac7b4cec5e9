"""A simulated tactile array: the normal force on the taxels of one pad of an episode."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from grasp_factory.capture.devices.tactile_array import COUNTERS, CRC, TactileArraySettings
from grasp_factory.capture.samples import TactileReading
from grasp_factory.capture.simulators.counts import counts
from grasp_factory.capture.simulators.serial_line import SimulatedSerialDevice
from grasp_factory.capture.simulators.tracks import DeviceTrack, tactile_track
from grasp_factory.core.episode import Episode

SHAPE = (8, 8)
SCALE_N = 0.005
"""One count: 16 bits reach 328 N."""
PAD_SIZE = (0.02, 0.02)
"""Width and height, m, of the pad that the taxels cover, unless another one is given."""
_US = 1000


class SimulatedTactileArray(SimulatedSerialDevice[TactileReading]):
    """Sends the left pad, unless ``pad`` is right."""

    resolution = 0.5 * SCALE_N

    def __init__(
        self,
        episode: Episode,
        *,
        pad: str = "left",
        pad_size: tuple[float, float] = PAD_SIZE,
        **playing: Any,
    ) -> None:
        self._pad, self._pad_size = pad, pad_size
        super().__init__(episode, **playing)

    @property
    def settings(self) -> Mapping[str, Any]:
        """See ``SimulatedDevice.settings``."""
        rows, columns = SHAPE
        array = {"rows": rows, "columns": columns, "scale": SCALE_N, "unit": "N"}
        return {**super().settings, **array}

    def track_of(self, episode: Episode, rate_hz: float) -> DeviceTrack[TactileReading]:
        """See ``SimulatedDevice.track_of``."""
        size = self._pad_size
        return tactile_track(episode, rate_hz, pad=self._pad, pad_size=size, shape=SHAPE)

    def packet(self, payload: TactileReading, number: int, device_ns: int) -> bytes:
        """See ``SimulatedSerialDevice.packet``."""
        rows, columns = SHAPE
        head = TactileArraySettings(port="-", rows=rows, columns=columns).header
        counters = COUNTERS.pack(number % 2**32, device_ns // _US % 2**32)
        taxels = np.array(counts(payload.pressure, SCALE_N, 16, is_signed=False), "<u2")
        return CRC.sealed(head + counters + taxels.tobytes())
