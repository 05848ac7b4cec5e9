"""What surrounds an attempt, as far as it is seen: surfaces and light."""

from __future__ import annotations

from dataclasses import dataclass, field

from grasp_factory.core.camera import Light
from grasp_factory.core.serialization import check

Color = tuple[float, float, float]
"""Red, green and blue, 0 to 1."""


def check_color(key: str, color: Color) -> None:
    """Raise ConfigError unless all parts lie in 0 to 1."""
    check(all(0.0 <= part <= 1.0 for part in color), key, list(color), "three values from 0 to 1")


@dataclass(frozen=True, slots=True, kw_only=True)
class SurfaceAppearance:
    """The look of something flat."""

    color: Color
    texture: str = ""
    """An id of ``textures``, multiplied with the colour; empty for none."""

    def __post_init__(self) -> None:
        check_color("color", self.color)


TABLE = SurfaceAppearance(color=(0.72, 0.55, 0.38))
FLOOR = SurfaceAppearance(color=(0.42, 0.44, 0.46))


@dataclass(frozen=True, slots=True, kw_only=True)
class Surroundings:
    """What is around the objects and changes nothing but images."""

    table: SurfaceAppearance = TABLE
    floor: SurfaceAppearance = FLOOR
    light: Light = field(default_factory=Light)
