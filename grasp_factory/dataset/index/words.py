"""Words that describe the numbers of a store's configuration or of a recipe."""

from __future__ import annotations

import json
import math
from functools import lru_cache
from typing import Any

from grasp_factory.core.config.factory_config import FactoryConfig
from grasp_factory.core.schema import MAX_CONTACTS

DIM, BRIGHT = 0.9, 1.3
"""Bounds of the sum of ambient and diffuse light: dim is below the first, bright is from the second
on. The default, 0.6 + 0.5, is normal."""
LOW_DEG, HIGH_DEG = 35.0, 65.0
"""Bounds of the light's angle above the horizon, in degrees: side is below the first, overhead is
from the second on. The default, 54 degrees, is slanted."""


def scenario(config: FactoryConfig) -> str:
    """Return where an attempt takes place, and among how many objects."""
    count = config.clutter.count
    return "table/single_object" if count == 1 else f"table/clutter_{count}"


@lru_cache(maxsize=4096)
def lighting(light: str) -> str | None:
    """Return how bright a recipe's light is and from where it comes, such as ``normal/slanted``.

    Args:
        light: The light as JSON; the result is None if it cannot be read.
    """
    try:
        plain = json.loads(light)
        strength = plain["ambient"] + plain["diffuse"]
        x, y, z = plain["direction"]
        height = math.degrees(math.atan2(z, math.hypot(x, y)))
    except (ValueError, TypeError, LookupError):
        return None
    brightness = "dim" if strength < DIM else "bright" if strength >= BRIGHT else "normal"
    where = "side" if height < LOW_DEG else "overhead" if height >= HIGH_DEG else "slanted"
    return f"{brightness}/{where}"


def sensor_setup(config: FactoryConfig) -> dict[str, Any]:
    """Return which sensors a store's episodes have, and their rates in Hz."""
    return {
        "cameras": {
            name: {
                "resolution": list(config.resolution),
                "mount": camera.mount.value,
                "fov_y_deg": camera.fov_y_deg,
            }
            for name, camera in config.cameras.items()
        },
        "record_hz": config.record_hz,
        "imu_hz": config.imu_rate,
        "video_hz": config.video_hz,
        "tactile": {"pads": 2, "contacts_per_pad": MAX_CONTACTS},
        "wrist": {"force_axes": 3, "torque_axes": 3},
    }
