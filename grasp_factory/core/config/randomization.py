"""The config's section on domain randomisation: ranges, all off by default, and named presets.

The recipe of an episode contains every drawn value, so a stored episode shows what was drawn.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Annotated

from grasp_factory.core.config.within import Within, check_within

Interval = tuple[float, float]
_SHARE = Within(0.0, 1.0)


@dataclass(frozen=True, slots=True, kw_only=True)
class ColorRange:
    """Colours in hue, saturation and brightness, each from 0 to 1."""

    share: Annotated[float, _SHARE] = 0.0
    """Probability that a colour is drawn; otherwise the original colour is kept."""
    hue: Annotated[Interval, _SHARE] = (0.0, 1.0)
    """Range of the hue: 0 and 1 are red."""
    saturation: Annotated[Interval, _SHARE] = (0.0, 0.9)
    """Range of the saturation: 0 is grey."""
    brightness: Annotated[Interval, _SHARE] = (0.2, 1.0)
    """Range of the brightness: 0 is black."""

    def __post_init__(self) -> None:
        check_within(self)


@dataclass(frozen=True, slots=True, kw_only=True)
class LooksConfig:
    """Appearance: colours, textures and light. They change only the images."""

    object_color: ColorRange = field(default_factory=ColorRange)
    """Colours of the objects."""
    object_texture: Annotated[float, _SHARE] = 0.0
    """Share of objects that have a texture."""
    table_color: ColorRange = field(default_factory=ColorRange)
    """Colour of the table."""
    table_texture: Annotated[float, _SHARE] = 0.0
    """Share of episodes whose table has a texture."""
    floor_color: ColorRange = field(default_factory=ColorRange)
    """Colour of the floor."""
    floor_texture: Annotated[float, _SHARE] = 0.0
    """Share of episodes whose floor has a texture."""
    light_azimuth_deg: Annotated[Interval, Within(-360.0, 360.0, "degrees")] = (56.0, 56.0)
    """Azimuth of the light source, from +x towards +y, degrees."""
    light_elevation_deg: Annotated[Interval, Within(5.0, 90.0, "degrees")] = (54.0, 54.0)
    """Elevation of the light source above the horizon, degrees."""
    light_hue: Annotated[Interval, _SHARE] = (0.0, 0.0)
    """Range of the light's hue: 0 and 1 are red."""
    light_saturation: Annotated[Interval, _SHARE] = (0.0, 0.0)
    """Range of the light's saturation: 0 is white."""
    ambient: Annotated[Interval, _SHARE] = (0.6, 0.6)
    """Range of the share of light that comes from everywhere."""
    diffuse: Annotated[Interval, _SHARE] = (0.5, 0.5)
    """Range of the share of light that surfaces scatter."""
    specular: Annotated[Interval, _SHARE] = (0.05, 0.05)
    """Range of the share of light that surfaces mirror."""

    def __post_init__(self) -> None:
        check_within(self)


@dataclass(frozen=True, slots=True, kw_only=True)
class CameraJitter:
    """Random changes of the cameras: limits, positive and negative, from the config's values.

    Cameras on the hand use a tenth of these limits.
    """

    eye: Annotated[float, Within(0.0, 1.0, "m")] = 0.0
    """Largest change of the place along each axis, metres."""
    target: Annotated[float, Within(0.0, 0.5, "m")] = 0.0
    """The same for the point that the camera looks at, metres."""
    roll_deg: Annotated[float, Within(0.0, 180.0, "degrees")] = 0.0
    """Largest turn about the line of sight, degrees."""
    fov_y_deg: Annotated[float, Within(0.0, 60.0, "degrees")] = 0.0
    """Largest change of the vertical field of view, degrees."""

    def __post_init__(self) -> None:
        check_within(self)


@dataclass(frozen=True, slots=True, kw_only=True)
class BodyRange:
    """Physical properties of the objects, drawn for each object."""

    scale: Annotated[Interval, Within(0.25, 2.0)] = (1.0, 1.0)
    """Factor on the size; it does not change the mass."""
    mass: Annotated[Interval, Within(0.1, 10.0)] = (1.0, 1.0)
    """Factor on the mass."""
    friction: Annotated[Interval, Within(0.1, 10.0)] = (1.0, 1.0)
    """Factor on the friction coefficient."""
    linear_damping: Annotated[Interval, Within(0.0, 0.9)] = (0.0, 0.0)
    """Bullet's damping: share of the velocity that is lost per second, as in thick air."""
    angular_damping: Annotated[Interval, Within(0.0, 0.9)] = (0.0, 0.0)
    """The same for the angular velocity."""

    def __post_init__(self) -> None:
        check_within(self)


@dataclass(frozen=True, slots=True, kw_only=True)
class GripperRange:
    """Factors on the force and the speeds of the section ``motion``."""

    force: Annotated[Interval, Within(0.1, 10.0)] = (1.0, 1.0)
    """Factor on ``grip_force``; the result is limited to the gripper's force range."""
    speed: Annotated[Interval, Within(0.2, 5.0)] = (1.0, 1.0)
    """Factor on the speeds of approach, closing and lift, not of transfer and shake."""

    def __post_init__(self) -> None:
        check_within(self)


@dataclass(frozen=True, slots=True, kw_only=True)
class RandomizeConfig:
    """Domain randomisation. Drop positions are always random (section ``workspace``)."""

    surroundings: Annotated[int, Within(0, 1_000_000)] = 0
    """Number of different surroundings (table, floor, light, cameras) that the episodes share.

    0 draws new surroundings for each episode. A small number renders faster, because static bodies
    are rendered once for each surroundings.
    """
    looks: LooksConfig = field(default_factory=LooksConfig)
    """Colours, textures and light."""
    cameras: CameraJitter = field(default_factory=CameraJitter)
    """Limits of random changes of the cameras; a tenth of them for cameras on the hand."""
    objects: BodyRange = field(default_factory=BodyRange)
    """Size, mass and friction of the objects."""
    gripper: GripperRange = field(default_factory=GripperRange)
    """Force and speed of the gripper."""

    def __post_init__(self) -> None:
        check_within(self)


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
