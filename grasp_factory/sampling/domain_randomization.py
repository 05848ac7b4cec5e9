"""Domain randomization: pure functions that draw appearance, cameras, bodies and motions."""

from __future__ import annotations

import colorsys
import dataclasses
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from grasp_factory.core.appearance import Color, SurfaceAppearance, Surroundings
from grasp_factory.core.camera import Light
from grasp_factory.core.config.cameras import CameraConfig, Mount
from grasp_factory.core.config.motion import MotionConfig
from grasp_factory.core.config.randomization import (
    BodyRange,
    CameraJitter,
    ColorRange,
    GripperRange,
    LooksConfig,
)
from grasp_factory.core.elementary import exp, log, sincos
from grasp_factory.core.geometry import look_at, rotation_about
from grasp_factory.core.linear import turned
from grasp_factory.core.textures import TEXTURES

HAND_SHARE = 0.1
"""Factor on the jitter of cameras on the hand: they are fixed more firmly than the others, and see
objects from a much shorter distance."""


@dataclass(frozen=True, slots=True)
class BodyDraw:
    """The draw for one object: factors on its model's size, mass and friction, and its damping."""

    scale: float
    mass: float
    friction: float
    linear_damping: float
    angular_damping: float


def draw_body(ranges: BodyRange, rng: np.random.Generator) -> BodyDraw:
    """Draw one object's physical parameters; the logarithms of the factors are uniform."""
    scale, mass, friction = (
        float(exp(rng.uniform(log(low), log(high))))
        for low, high in (ranges.scale, ranges.mass, ranges.friction)
    )
    linear, angular = (
        float(rng.uniform(*ends)) for ends in (ranges.linear_damping, ranges.angular_damping)
    )
    return BodyDraw(scale, mass, friction, linear, angular)


def draw_motion(
    ranges: GripperRange, motion: MotionConfig, rng: np.random.Generator
) -> MotionConfig:
    """Draw the grip's force and the speeds of an attempt."""
    force, speed = rng.uniform(*ranges.force), rng.uniform(*ranges.speed)
    return motion.scaled(float(force), float(speed))


def draw_object_look(looks: LooksConfig, rng: np.random.Generator) -> tuple[Color | None, str]:
    """Draw an object's colour (None for its own) and texture ('' for no texture)."""
    return _color(looks.object_color, rng), _texture(looks.object_texture, rng)


def draw_surroundings(looks: LooksConfig, rng: np.random.Generator) -> Surroundings:
    """Draw the appearance of table and floor, and the light."""
    own = Surroundings()
    table = _surface(own.table, looks.table_color, looks.table_texture, rng)
    floor = _surface(own.floor, looks.floor_color, looks.floor_texture, rng)
    azimuth = math.radians(rng.uniform(*looks.light_azimuth_deg))
    elevation = math.radians(rng.uniform(*looks.light_elevation_deg))
    (up, across), (y, x) = sincos(elevation), sincos(azimuth)
    hue, saturation = rng.uniform(*looks.light_hue), rng.uniform(*looks.light_saturation)
    ambient, diffuse, specular = (
        float(rng.uniform(*ends)) for ends in (looks.ambient, looks.diffuse, looks.specular)
    )
    light = Light(
        direction=(float(across * x), float(across * y), float(up)),
        color=colorsys.hsv_to_rgb(hue, saturation, 1.0),
        ambient=ambient,
        diffuse=diffuse,
        specular=specular,
    )
    return Surroundings(table=table, floor=floor, light=light)


def draw_cameras(
    jitter: CameraJitter,
    cameras: Mapping[str, CameraConfig],
    rng_of: Callable[[str], np.random.Generator],
) -> dict[str, CameraConfig]:
    """Draw the pose of each camera, in the order of their names.

    Args:
        jitter: Limits of the random changes of pose and field of view.
        cameras: The cameras by name.
        rng_of: Returns the random generator for a camera's name. Each camera has its own, so that
            an additional camera does not change the others.
    """
    return {name: _moved(jitter, cameras[name], rng_of(name)) for name in sorted(cameras)}


def _moved(jitter: CameraJitter, camera: CameraConfig, rng: np.random.Generator) -> CameraConfig:
    share = HAND_SHARE if camera.mount is Mount.TCP else 1.0
    eye, target = (
        np.array(point) + share * limit * rng.uniform(-1.0, 1.0, 3)
        for point, limit in ((camera.eye, jitter.eye), (camera.target, jitter.target))
    )
    roll = share * math.radians(jitter.roll_deg) * rng.uniform(-1.0, 1.0)
    wider = share * jitter.fov_y_deg * rng.uniform(-1.0, 1.0)
    if jitter == CameraJitter():
        return camera  # unchanged, bit for bit
    forward = look_at(eye, target, camera.up)[:3, 2]
    up = turned(rotation_about(forward, roll), np.array(camera.up))
    return dataclasses.replace(
        camera,
        eye=tuple(eye.tolist()),
        target=tuple(target.tolist()),
        up=tuple(up.tolist()),
        fov_y_deg=camera.fov_y_deg + float(wider),
    )


def _surface(
    own: SurfaceAppearance, colors: ColorRange, textured: float, rng: np.random.Generator
) -> SurfaceAppearance:
    color, texture = _color(colors, rng), _texture(textured, rng)
    return SurfaceAppearance(color=own.color if color is None else color, texture=texture)


def _color(colors: ColorRange, rng: np.random.Generator) -> Color | None:
    is_drawn = rng.random() < colors.share
    hue, saturation, brightness = (
        float(rng.uniform(*ends)) for ends in (colors.hue, colors.saturation, colors.brightness)
    )
    return colorsys.hsv_to_rgb(hue, saturation, brightness) if is_drawn else None


def _texture(share: float, rng: np.random.Generator) -> str:
    is_drawn, which = rng.random() < share, int(rng.integers(len(TEXTURES)))
    return TEXTURES[which] if is_drawn else ""
