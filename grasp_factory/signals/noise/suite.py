"""The noise models of all sensors of a robot, under one name."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

from grasp_factory.errors import lookup
from grasp_factory.signals.noise.depth import STEREO, STRUCTURED_LIGHT, DepthNoise
from grasp_factory.signals.noise.encoders import LIGHTWEIGHT, EncoderNoise
from grasp_factory.signals.noise.imu import BMI088, ImuNoise
from grasp_factory.signals.noise.rgb import SMALL_PIXELS, RgbNoise
from grasp_factory.signals.noise.tactile import PIEZORESISTIVE, TactileNoise
from grasp_factory.signals.noise.wrench import MINI45, WrenchNoise


@dataclass(frozen=True, slots=True, kw_only=True)
class SensorNoise:
    """The imperfections of all sensors; None leaves the signals of a sensor unchanged."""

    depth: DepthNoise | None = None
    """Noise of every camera."""
    rgb: RgbNoise | None = None
    """Noise of every camera."""
    tactile: TactileNoise | None = None
    wrist: WrenchNoise | None = None
    encoders: EncoderNoise | None = None
    imu: ImuNoise | None = None


_STEREO = SensorNoise(
    depth=STEREO,
    rgb=SMALL_PIXELS,
    tactile=PIEZORESISTIVE,
    wrist=MINI45,
    encoders=LIGHTWEIGHT,
    imu=BMI088,
)

NOISE: Mapping[str, SensorNoise] = {
    "none": SensorNoise(),
    "structured_light": replace(_STEREO, depth=STRUCTURED_LIGHT),
    "stereo": _STEREO,
}
"""By the kind of depth camera; the other sensors are the same in both."""


def named_noise(noise: str | SensorNoise | None) -> SensorNoise:
    """Return the entry of ``NOISE`` with a name; None is no noise, a record stays as it is.

    Raises:
        UnknownNameError: listing the names.
    """
    if isinstance(noise, str):
        return lookup(NOISE, "noise", noise)
    return noise or NOISE["none"]
