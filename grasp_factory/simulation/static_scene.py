"""The static part of a scene: floor, table, robot base, light, cameras and their backgrounds."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from grasp_factory.core.appearance import Surroundings
from grasp_factory.core.camera import Camera
from grasp_factory.core.config.cameras import CameraConfig, Mount
from grasp_factory.core.episode import EpisodeSpec
from grasp_factory.core.geometry import IDENTITY
from grasp_factory.core.workspace import TABLE_CENTER_XY, TABLE_HEIGHT, TABLE_SIZE
from grasp_factory.errors import lookup
from grasp_factory.robots import ROBOTS, RobotModel
from grasp_factory.simulation.images import Render, make_camera, render
from grasp_factory.simulation.robot import Robot
from grasp_factory.simulation.world import World
from grasp_factory.simulation.world.foot import foot_of

FLOOR_SIZE = (8.0, 8.0, 0.10)
TABLE_FRICTION = 1.0
"""The engine multiplies the values of two bodies: with 1, the object's own value applies."""
TABLE_ROLLING_FRICTION = 0.001
"""Metres of rolling resistance, so that round objects come to rest. The table has it, not the
objects: Bullet does not report rolling moments, so pads would miss part of the contact wrench."""
TABLE_SPINNING_FRICTION = 0.001
"""The same for spinning in place: nothing else would stop a spinning ball."""

FOOT = (-1,)
"""Links of a robot that never move: its base."""

MAX_BACKGROUNDS = 64
"""Size of the cache of backgrounds: it is full after about a hundred episodes."""
MAX_BACKGROUND_BYTES = 200_000_000
"""Limit of the whole cache: 59 backgrounds at 640x480, or 19 surroundings with three cameras."""


@dataclass(frozen=True, slots=True)
class Stage:
    """Floor and table, hidden in the world, and the cameras.

    For a static camera, floor, table and the robot's base are rendered once, and composited with
    the moving bodies.
    """

    world: World
    floor: int
    """Body."""
    table: int
    """Body."""
    surroundings: Surroundings
    still: Mapping[str, tuple[Camera, Render]]
    """Static cameras, each with its background; empty if the renderer cannot composite."""
    moving: Mapping[str, CameraConfig]
    """The other cameras: those on the hand."""
    resolution: tuple[int, int]

    def look(self, name: str, robot: Robot) -> tuple[Camera, Render]:
        """Render everything through one camera."""
        light = self.surroundings.light
        if name in self.still:
            camera, background = self.still[name]
            foot = self.world.hide(robot.body, FOOT)
            moving = render(self.world, camera, light)
            self.world.show(robot.body, foot)
            return camera, background.behind(moving)
        config = self.moving[name]
        mount = robot.T_world_tcp() if config.mount is Mount.TCP else None
        camera = make_camera(name, config, self.resolution, self.world.renderer, mount)
        _dress(self.world, self.floor, self.table, self.surroundings)
        whole = render(self.world, camera, light)
        _hide(self.world, self.floor, self.table)
        return camera, whole


_Key = tuple[Surroundings, CameraConfig, tuple[int, int], str]
_backgrounds: dict[_Key, Render] = {}
"""A cache that episodes with the same surroundings share."""


def set_stage(world: World, spec: EpisodeSpec) -> Stage:
    """Empty the world, add floor and table, and set up all cameras."""
    still = {
        name: c
        for name, c in spec.cameras.items()
        if c.mount is Mount.WORLD and world.renderer.composites
    }
    moving = {name: c for name, c in spec.cameras.items() if name not in still}
    backgrounds = {name: _background(world, spec, name) for name in still}
    floor, table = _start(world, spec)
    _hide(world, floor, table)
    return Stage(world, floor, table, spec.surroundings, backgrounds, moving, spec.resolution)


def _background(world: World, spec: EpisodeSpec, name: str) -> tuple[Camera, Render]:
    """Return a camera and its render of floor, table and foot alone.

    It is rendered after a reset of the world. In the engine's images, the last bit of a few pixels
    depends on how many images were rendered since the last reset. An episode must not depend on
    whether its background was cached.
    """
    config = spec.cameras[name]
    camera = make_camera(name, config, spec.resolution, world.renderer)
    key = (spec.surroundings, config, spec.resolution, spec.robot)
    found = _backgrounds.pop(key, None)
    if found is None:
        _dress(world, *_start(world, spec), spec.surroundings)
        _load_foot(world, lookup(ROBOTS, "robot", spec.robot))
        found = render(world, camera, spec.surroundings.light).packed()
    _backgrounds[key] = found  # the last entry is the most recently used
    most = max(1, min(MAX_BACKGROUNDS, MAX_BACKGROUND_BYTES // found.nbytes))
    while len(_backgrounds) > most:
        del _backgrounds[next(iter(_backgrounds))]
    return camera, found


def _start(world: World, spec: EpisodeSpec) -> tuple[int, int]:
    """Empty the world, add floor and table and return the bodies."""
    world.reset(spec.physics)
    floor = _add_slab(world, FLOOR_SIZE, (0.0, 0.0), -TABLE_HEIGHT)
    return floor, _add_slab(world, TABLE_SIZE, TABLE_CENTER_XY, 0.0)


def _load_foot(world: World, model: RobotModel) -> None:
    """Load a robot's base alone, at the pose that it has in the whole robot."""
    file = foot_of(model.path())
    world.load_urdf(file, IDENTITY, fixed=True, file_inertia=model.file_inertia)


def _add_slab(world: World, size: Sequence[float], center_xy: Sequence[float], top: float) -> int:
    position = (*center_xy, top - size[2] / 2.0)
    body = world.add_box([side / 2.0 for side in size], position, (1.0, 1.0, 1.0, 1.0))
    world.change_dynamics(
        body,
        -1,
        lateralFriction=TABLE_FRICTION,
        rollingFriction=TABLE_ROLLING_FRICTION,
        spinningFriction=TABLE_SPINNING_FRICTION,
    )
    return body


def _dress(world: World, floor: int, table: int, surroundings: Surroundings) -> None:
    for body, look in ((floor, surroundings.floor), (table, surroundings.table)):
        world.set_look(body, look.color, look.texture)


def _hide(world: World, floor: int, table: int) -> None:
    for body in (floor, table):
        world.hide(body)
