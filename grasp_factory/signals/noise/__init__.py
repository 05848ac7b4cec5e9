"""What real sensors add to the clean truth of a store, applied when reading and never stored.

One module per sensor with its model, its equation and a preset; ``NOISE`` has them together.
"""

from __future__ import annotations

from grasp_factory.signals.noise.depth import STEREO, STRUCTURED_LIGHT, DepthNoise
from grasp_factory.signals.noise.encoders import LIGHTWEIGHT, EncoderNoise
from grasp_factory.signals.noise.episode import EpisodeNoise, noisy
from grasp_factory.signals.noise.rgb import SMALL_PIXELS, RgbNoise
from grasp_factory.signals.noise.suite import NOISE, SensorNoise, named_noise
from grasp_factory.signals.noise.tactile import PIEZORESISTIVE, TactileNoise
from grasp_factory.signals.noise.wrench import MINI45, WrenchNoise

__all__ = [
    "LIGHTWEIGHT",
    "MINI45",
    "NOISE",
    "PIEZORESISTIVE",
    "SMALL_PIXELS",
    "STEREO",
    "STRUCTURED_LIGHT",
    "DepthNoise",
    "EncoderNoise",
    "EpisodeNoise",
    "RgbNoise",
    "SensorNoise",
    "TactileNoise",
    "WrenchNoise",
    "named_noise",
    "noisy",
]
