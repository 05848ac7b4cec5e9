"""A session without hardware: simulated devices play an episode over their real transports."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from importlib.util import find_spec
from typing import Any, Protocol, Self

from grasp_factory.capture.devices import DEVICES
from grasp_factory.capture.devices.base import DeviceModel, class_at
from grasp_factory.capture.samples import DeviceKind
from grasp_factory.capture.session.events import EPISODE_END, EPISODE_START
from grasp_factory.capture.session.recorder import SessionRecorder
from grasp_factory.capture.session.session_config import DeviceConfig, SessionConfig
from grasp_factory.capture.session.tolerances import Tolerances
from grasp_factory.core.episode import Episode
from grasp_factory.errors import UsageError

NAMES: Mapping[DeviceKind, str] = {
    DeviceKind.CAMERA: "front",
    DeviceKind.IMU: "imu",
    DeviceKind.FORCE_TORQUE: "wrist",
    DeviceKind.TACTILE: "pad",
    DeviceKind.JOINTS: "arm",
}
"""The name of the device of each kind."""
STILL_S = 600.0
"""Tolerance of images that do not change: an episode without video shows the same one all along."""
AFTERWARDS_S = 0.5
"""Seconds that are recorded after the attempt."""


class PlayedDevice(Protocol):
    """A simulated device, as ``DeviceModel.simulator`` names its class; used in ``with``."""

    @property
    def settings(self) -> Mapping[str, Any]:
        """The settings with which the driver finds it."""

    def play(self) -> None:
        """Begin to send the episode."""

    def __enter__(self) -> Self: ...

    def __exit__(self, *_: object) -> None: ...


@dataclass(frozen=True, slots=True, kw_only=True)
class DemoStage:
    """Simulated devices that are ready, and the settings of a session that records them."""

    config: SessionConfig
    episode: Episode
    players: tuple[PlayedDevice, ...]

    def start(self, recorder: SessionRecorder) -> None:
        """Let the devices play, and mark the start of the episode."""
        recorder.log.add(EPISODE_START, {"by": "demo"})
        for player in self.players:
            player.play()

    def finish(self, recorder: SessionRecorder) -> None:
        """Mark the end of the episode."""
        recorder.log.add(EPISODE_END, {"by": "demo", "success": self.episode.success})


def demo_models() -> dict[str, DeviceModel]:
    """Return the first device of each kind that has a simulator, and whose libraries are there.

    Raises:
        UsageError: if there is none.
    """
    found: dict[str, DeviceModel] = {}
    for model in DEVICES.values():
        if model.simulator and all(map(find_spec, model.modules)):
            found.setdefault(NAMES[model.kind], model)
    if not found:
        raise UsageError("no device can be simulated here: pip install 'grasp-factory[capture]'")
    return found


@contextlib.contextmanager
def demo_stage(episode: Episode, models: Mapping[str, DeviceModel]) -> Iterator[DemoStage]:
    """Yield simulated devices that are plugged in.

    Args:
        episode: what they play, with the noise of sensors.
        models: the devices by name.
    """
    with contextlib.ExitStack() as stack:
        players: dict[str, PlayedDevice] = {
            name: stack.enter_context(class_at(model.simulator)(episode))
            for name, model in models.items()
        }
        length = float(episode.streams["timestamp"][-1])
        config = SessionConfig(
            devices={
                name: DeviceConfig(driver=models[name].name, settings=dict(player.settings))
                for name, player in players.items()
            },
            operator="demo",
            task="grasp",
            tags=("simulated",),
            duration_s=length + AFTERWARDS_S,
            tolerances=Tolerances() if episode.videos else Tolerances(frozen_s=STILL_S),
        )
        yield DemoStage(config=config, episode=episode, players=tuple(players.values()))
