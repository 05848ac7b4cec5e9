"""Noise of each sensor on the records of an episode; it does not depend on how they are read."""

from __future__ import annotations

import zlib
from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from grasp_factory.core.episode import CameraFrames, Episode, Streams
from grasp_factory.core.geometry import Array
from grasp_factory.core.serialization import is_integer
from grasp_factory.errors import UsageError, shown
from grasp_factory.signals.noise import depth, encoders, rgb, tactile, wrench
from grasp_factory.signals.noise.imu import apply as apply_imu_noise
from grasp_factory.signals.noise.suite import SensorNoise, named_noise

_READS = {
    "tactile": ("tactile_wrench", "tactile_force"),
    "wrist": ("wrist_wrench",),
    "encoders": ("joint_positions", "joint_velocities", "gripper_width"),
}
"""By field of ``SensorNoise``: the streams that its noise changes. It needs all of them."""


def noisy(episode: Episode, noise: str | SensorNoise, seed: int = 0) -> Episode:
    """Return an episode as noisy sensors would have measured it.

    Outcome, columns, spec, segmentation, poses, commands, torques and videos stay unchanged.

    Args:
        episode: The episode without noise.
        noise: The sensors, or their name in ``NOISE``.
        seed: The same seed yields the same bytes. Every episode, camera, frame and sensor has its
            own noise.

    Raises:
        UnknownNameError: for a name that is not in ``NOISE``.
        UsageError: for an invalid seed.
    """
    return EpisodeNoise(named_noise(noise), seed).episode(episode)


@dataclass(frozen=True, slots=True)
class EpisodeNoise:
    """A suite of sensors and a seed."""

    noise: SensorNoise
    seed: int

    def __post_init__(self) -> None:
        """Check the seed.

        Raises:
            UsageError: naming an invalid seed.
        """
        if not is_integer(self.seed) or self.seed < 0:
            raise UsageError(f"noise seed: got {shown(self.seed)}, valid: a whole number from 0 on")

    def episode(self, clean: Episode) -> Episode:
        """Return an episode as noisy sensors would have measured it (see ``noisy``)."""
        spec = clean.spec
        cameras = {
            name: self._frames(spec.index, name, frames, spec.cameras[name].far)
            for name, frames in clean.cameras.items()
        }
        streams = self.streams(spec.index, clean.streams, spec.record_hz)
        imu = self._imu(spec.index, clean.imu, spec.imu_hz)
        own_rate = {**clean.own_rate, "imu": imu}
        return replace(clean, cameras=cameras, streams=streams, own_rate=own_rate)

    @property
    def images(self) -> tuple[str, ...]:
        """Kinds of images that have noise."""
        return tuple(kind for kind in ("rgb", "depth") if getattr(self.noise, kind))

    def image(
        self,
        clean: NDArray[Any],
        K: Array,
        far: float,
        *,
        index: int,
        camera: str,
        kind: str,
        frame: int,
    ) -> NDArray[Any]:
        """Return one image as a noisy camera would have taken it.

        Args:
            clean: (H, W, ...).
            K: (3, 3) pixels.
            far: Far plane, metres: at this depth or more, nothing is visible.
            index: Index of the episode.
            camera: Name of the camera.
            kind: One of ``images``; an image of any other kind stays unchanged.
            frame: 0 for the image before the attempt, 1 for the image after it.
        """
        seed = self._seed(index, f"cameras/{camera}/{kind}/{frame}")
        if kind == "depth" and self.noise.depth:
            return depth.corrupt(self.noise.depth, clean, K, far, seed)
        if kind == "rgb" and self.noise.rgb:
            return rgb.corrupt(self.noise.rgb, clean, seed)
        return clean

    def needs(self, names: Iterable[str]) -> list[str]:
        """Return the streams to read for some streams: these and the ones that they depend on."""
        wanted = dict.fromkeys(names)
        groups = [reads for sensor, reads in _READS.items() if getattr(self.noise, sensor)]
        more = [name for reads in groups if wanted.keys() & set(reads) for name in reads]
        return list(wanted | dict.fromkeys(more))

    def streams(self, index: int, clean: Streams, rate_hz: float) -> dict[str, NDArray[Any]]:
        """Return an episode's streams as noisy sensors would have measured them.

        Args:
            index: Index of the episode.
            clean: Streams without noise, each (T, ...): all that ``needs`` returns for a sensor, or
                none of them.
            rate_hz: Records per second.
        """
        changed: dict[str, Array] = {}
        for sensor, reads in _READS.items():
            model = getattr(self.noise, sensor)
            if model is None or not set(reads) <= clean.keys():
                continue
            seed, first = self._seed(index, f"streams/{sensor}"), clean[reads[0]]
            if sensor == "tactile":
                felt = tactile.corrupt(model, first, rate_hz, seed)
                changed["tactile_wrench"] = felt
                changed["tactile_force"] = tactile.carry_over(clean, felt)
            elif sensor == "wrist":
                changed["wrist_wrench"] = wrench.corrupt(model, first, rate_hz, seed)
            else:
                speed, width = clean["joint_velocities"], clean["gripper_width"]
                changed |= encoders.corrupt(model, first, speed, width, seed)._asdict()
        return dict(clean) | {k: v.astype(clean[k].dtype) for k, v in changed.items()}

    def _frames(self, index: int, camera: str, clean: CameraFrames, far: float) -> CameraFrames:
        K = clean.intrinsics
        images = {}
        for kind in self.images:
            images[kind] = np.stack([
                self.image(image, K, far, index=index, camera=camera, kind=kind, frame=frame)
                for frame, image in enumerate(getattr(clean, kind))
            ])  # fmt: skip
        return replace(clean, **images)

    def _imu(self, index: int, clean: Streams, rate_hz: float) -> Streams:
        if self.noise.imu is None:
            return clean
        signals = clean["specific_force"], clean["angular_velocity"]
        # As in the example of docs/reference/signals.md, so that users can add the same noise.
        read = apply_imu_noise(self.noise.imu, *signals, rate_hz, [self.seed, index])
        return dict(clean) | {k: v.astype(clean[k].dtype) for k, v in read._asdict().items()}

    def _seed(self, index: int, path: str) -> np.random.SeedSequence:
        key = (index, zlib.crc32(path.encode()))
        return np.random.SeedSequence(int(self.seed), spawn_key=key)
