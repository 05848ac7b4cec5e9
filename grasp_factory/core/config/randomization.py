"""The config's section on domain randomisation: ranges, all off by default, and named presets.

The recipe of an episode contains every drawn value, so a stored episode shows what was drawn.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from grasp_factory.core.serialization import check, check_range

Interval = tuple[float, float]


def _check_ranges(record: object, low: float, high: float, *keys: str) -> None:
    for key in keys:
        bottom, top = getattr(record, key)
        check(low <= bottom <= top <= high, key, [bottom, top], f"{low} <= low <= high <= {high}")


@dataclass(frozen=True, slots=True, kw_only=True)
class ColorRange:
    """Colours in hue, saturation and brightness, each from 0 to 1."""

    share: float = 0.0
    """Probability that a colour is drawn; otherwise the original colour is kept."""
    hue: Interval = (0.0, 1.0)
    saturation: Interval = (0.0, 0.9)
    brightness: Interval = (0.2, 1.0)

    def __post_init__(self) -> None:
        check_range(self, "share", 0.0, 1.0)
        _check_ranges(self, 0.0, 1.0, "hue", "saturation", "brightness")


@dataclass(frozen=True, slots=True, kw_only=True)
class LooksConfig:
    """Appearance: colours, textures and light. They change only the images."""

    object_color: ColorRange = field(default_factory=ColorRange)
    object_texture: float = 0.0
    """Share of objects that have a texture."""
    table_color: ColorRange = field(default_factory=ColorRange)
    table_texture: float = 0.0
    floor_color: ColorRange = field(default_factory=ColorRange)
    floor_texture: float = 0.0
    light_azimuth_deg: Interval = (56.0, 56.0)
    """Azimuth of the light source, from +x towards +y, degrees."""
    light_elevation_deg: Interval = (54.0, 54.0)
    """Elevation of the light source above the horizon, degrees."""
    light_hue: Interval = (0.0, 0.0)
    light_saturation: Interval = (0.0, 0.0)
    ambient: Interval = (0.6, 0.6)
    diffuse: Interval = (0.5, 0.5)
    specular: Interval = (0.05, 0.05)

    def __post_init__(self) -> None:
        for key in ("object_texture", "table_texture", "floor_texture"):
            check_range(self, key, 0.0, 1.0)
        _check_ranges(self, -360.0, 360.0, "light_azimuth_deg")
        _check_ranges(self, 5.0, 90.0, "light_elevation_deg")
        unit = ("light_hue", "light_saturation", "ambient", "diffuse", "specular")
        _check_ranges(self, 0.0, 1.0, *unit)


@dataclass(frozen=True, slots=True, kw_only=True)
class CameraJitter:
    """Random changes of the cameras: limits, positive and negative, from the config's values.

    Cameras on the hand use a tenth of these limits.
    """

    eye: float = 0.0
    """Metres along each axis."""
    target: float = 0.0
    """Metres along each axis, for the point that the camera looks at."""
    roll_deg: float = 0.0
    fov_y_deg: float = 0.0

    def __post_init__(self) -> None:
        check_range(self, "eye", 0.0, 1.0, "m")
        check_range(self, "target", 0.0, 0.5, "m")
        check_range(self, "roll_deg", 0.0, 180.0, "degrees")
        check_range(self, "fov_y_deg", 0.0, 60.0, "degrees")


@dataclass(frozen=True, slots=True, kw_only=True)
class BodyRange:
    """Physical properties of the objects, drawn for each object."""

    scale: Interval = (1.0, 1.0)
    """Factor on the size; it does not change the mass."""
    mass: Interval = (1.0, 1.0)
    """Factor on the mass."""
    friction: Interval = (1.0, 1.0)
    """Factor on the friction coefficient."""
    linear_damping: Interval = (0.0, 0.0)
    """Bullet's damping: share of the velocity that is lost per second, as in thick air."""
    angular_damping: Interval = (0.0, 0.0)

    def __post_init__(self) -> None:
        _check_ranges(self, 0.25, 2.0, "scale")
        _check_ranges(self, 0.1, 10.0, "mass", "friction")
        _check_ranges(self, 0.0, 0.9, "linear_damping", "angular_damping")


@dataclass(frozen=True, slots=True, kw_only=True)
class GripperRange:
    """Factors on the force and the speeds of the section ``motion``."""

    force: Interval = (1.0, 1.0)
    """Factor on ``grip_force``; the result is limited to the gripper's force range."""
    speed: Interval = (1.0, 1.0)
    """Factor on the speeds of approach, closing and lift, not of transfer and shake."""

    def __post_init__(self) -> None:
        _check_ranges(self, 0.1, 10.0, "force")
        _check_ranges(self, 0.2, 5.0, "speed")


@dataclass(frozen=True, slots=True, kw_only=True)
class RandomizeConfig:
    """Domain randomisation. Drop positions are always random (section ``workspace``)."""

    surroundings: int = 0
    """Number of different surroundings (table, floor, light, cameras) that the episodes share.

    0 draws new surroundings for each episode. A small number renders faster, because static bodies
    are rendered once for each surroundings.
    """
    looks: LooksConfig = field(default_factory=LooksConfig)
    cameras: CameraJitter = field(default_factory=CameraJitter)
    objects: BodyRange = field(default_factory=BodyRange)
    gripper: GripperRange = field(default_factory=GripperRange)

    def __post_init__(self) -> None:
        check_range(self, "surroundings", 0, 1_000_000)


_LIGHT_LOOKS = LooksConfig(
    object_color=ColorRange(share=0.8),
    table_color=ColorRange(share=0.5, saturation=(0.0, 0.5), brightness=(0.4, 1.0)),
    floor_color=ColorRange(share=0.5, saturation=(0.0, 0.3), brightness=(0.3, 0.8)),
    table_texture=0.3,
    light_azimuth_deg=(0.0, 110.0),
    light_elevation_deg=(40.0, 75.0),
    ambient=(0.5, 0.7),
    diffuse=(0.4, 0.6),
)
_STRONG_LOOKS = LooksConfig(
    object_color=ColorRange(share=0.95),
    object_texture=0.5,
    table_color=ColorRange(share=0.95),
    table_texture=0.7,
    floor_color=ColorRange(share=0.95),
    floor_texture=0.7,
    light_azimuth_deg=(-180.0, 180.0),
    light_elevation_deg=(20.0, 90.0),
    light_hue=(0.0, 1.0),
    light_saturation=(0.0, 0.25),
    ambient=(0.3, 0.8),
    diffuse=(0.2, 0.8),
    specular=(0.0, 0.4),
)

RANDOMIZE_PRESETS: Mapping[str, RandomizeConfig] = {
    "none": RandomizeConfig(),
    "looks": RandomizeConfig(looks=_STRONG_LOOKS),
    "light": RandomizeConfig(
        surroundings=16,
        looks=_LIGHT_LOOKS,
        cameras=CameraJitter(eye=0.03, target=0.02, roll_deg=2.0, fov_y_deg=1.0),
        objects=BodyRange(scale=(0.9, 1.1), mass=(0.7, 1.5), friction=(0.8, 1.25)),
    ),
    "strong": RandomizeConfig(
        looks=_STRONG_LOOKS,
        cameras=CameraJitter(eye=0.12, target=0.04, roll_deg=8.0, fov_y_deg=4.0),
        objects=BodyRange(
            scale=(0.75, 1.15),
            mass=(0.4, 3.0),
            friction=(0.6, 1.6),
            linear_damping=(0.0, 0.1),
            angular_damping=(0.0, 0.1),
        ),
        gripper=GripperRange(force=(0.5, 1.75), speed=(0.7, 1.3)),
    ),
}
"""Preset name to settings. ``looks`` has the appearance of ``strong``, the physics of ``none``."""
