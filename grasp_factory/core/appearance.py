"""The appearance of the surroundings of an attempt: table, floor and light."""

from __future__ import annotations

from dataclasses import dataclass, field

from grasp_factory.core.camera import Light
from grasp_factory.core.serialization import check

Color = tuple[float, float, float]
"""Red, green and blue, 0 to 1."""


def check_color(key: str, color: Color) -> None:
    """Raise ConfigError unless all components are from 0 to 1."""
    check(all(0.0 <= part <= 1.0 for part in color), key, list(color), "three values from 0 to 1")


@dataclass(frozen=True, slots=True, kw_only=True)
class SurfaceAppearance:
    """The appearance of a flat surface."""

    color: Color
    texture: str = ""
    """An id of ``textures``; the image is multiplied with the colour. Empty for no texture."""

    def __post_init__(self) -> None:
        check_color("color", self.color)


TABLE = SurfaceAppearance(color=(0.72, 0.55, 0.38))
FLOOR = SurfaceAppearance(color=(0.42, 0.44, 0.46))


@dataclass(frozen=True, slots=True, kw_only=True)
class Surroundings:
    """Table, floor and light. They change only the images."""

    table: SurfaceAppearance = TABLE
    floor: SurfaceAppearance = FLOOR
    light: Light = field(default_factory=Light)
