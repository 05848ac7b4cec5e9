"""A simulated robot: joints, commands and gripper of an episode as JSON datagrams."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

from grasp_factory.capture.samples import JointReading
from grasp_factory.capture.simulators.datagrams import LOOPBACK, SimulatedUdpDevice, free_port
from grasp_factory.capture.simulators.tracks import DeviceTrack, joints_track
from grasp_factory.core.episode import Episode


class SimulatedJoints(SimulatedUdpDevice[JointReading]):
    """Sends to the port at which the driver listens.

    Args:
        episode: the episode.
        stopped_after_s: from then on it says that its emergency stop is active; None for never.
        playing: see ``SimulatedDevice``.
    """

    resolution = 0.0

    def __init__(
        self, episode: Episode, *, stopped_after_s: float | None = None, **playing: Any
    ) -> None:
        super().__init__(episode, **playing)
        self._stopped_after_s, self._port = stopped_after_s, free_port()
        self._joints = len(self.track.payloads[0].positions)

    @property
    def settings(self) -> Mapping[str, Any]:
        """See ``SimulatedDevice.settings``."""
        names = [f"joint_{k}" for k in range(1, self._joints + 1)]
        return {"listen": LOOPBACK, "port": self._port, "joint_names": names}

    def receiver(self) -> tuple[str, int]:
        """See ``SimulatedUdpDevice.receiver``."""
        return LOOPBACK, self._port

    def track_of(self, episode: Episode, rate_hz: float) -> DeviceTrack[JointReading]:
        """See ``SimulatedDevice.track_of``."""
        return joints_track(episode, rate_hz)

    def datagram(self, payload: JointReading, number: int, device_ns: int) -> bytes:
        """See ``SimulatedUdpDevice.datagram``."""
        after = self._stopped_after_s
        return json.dumps({
            "sequence": number % 2**32,
            "time_ns": device_ns,
            "positions": payload.positions.tolist(),
            "velocities": payload.velocities.tolist(),
            "torques": payload.torques.tolist(),
            "position_targets": payload.position_targets.tolist(),
            "gripper_width": payload.gripper_width,
            "gripper_width_target": payload.gripper_width_target,
            "gripper_force": payload.gripper_force,
            "stopped": after is not None and device_ns >= after * 1e9,
        }).encode()  # fmt: skip
