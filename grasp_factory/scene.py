"""The scene of an episode: floor, table, robot, objects; built, settled, looked at."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from grasp_factory.camera import Camera
from grasp_factory.episode import CameraImage, EpisodeSpec, SceneView
from grasp_factory.errors import RecipeError, lookup
from grasp_factory.geometry import Array
from grasp_factory.objects import OBJECT_SETS, UrdfFile
from grasp_factory.outcome import Label, Outcome
from grasp_factory.robots import ROBOTS, Robot
from grasp_factory.sections import CameraConfig, WorkspaceConfig
from grasp_factory.sensors import Render, capture, make_camera, render
from grasp_factory.world import DATA, World

TABLE_CENTER_XY = (0.45, 0.0)
"""Metres; the robot's base, at the origin, stands 0.25 m inside the table's near edge."""
TABLE_SIZE = (1.40, 1.40, 0.05)
TABLE_HEIGHT = 0.75
"""Metres between floor and table top, which is z = 0."""
TABLE_FRICTION = 1.0
"""The pair's friction is the product, so the object's own value decides."""
TABLE_ROLLING_FRICTION = 0.001
"""Metres of rolling resistance, so that round things come to rest. It sits on the table and not
on the objects, because Bullet does not report rolling moments and touch must be whole."""
TABLE_RGBA = (0.72, 0.55, 0.38, 1.0)
FLOOR_RGBA = (0.42, 0.44, 0.46, 1.0)

MAX_BACKGROUNDS = 16
"""Backgrounds kept in memory, 3.4 MB each at 640x480."""

SETTLED_WAY = 0.0003
"""Metres that the centre of mass of a resting object may move within ``SETTLED_S``."""
SETTLED_TURN = 0.006
"""Radians that it may turn: a point 5 cm from the centre moves by the way above."""
SETTLED_S = 0.25
"""Displacement is judged, not velocity: that of a compound of hulls at rest chatters with the
solver at several mm/s, though the object stays where it is."""
SETTLE_CHECKS_PER_WINDOW = 5


@dataclass(frozen=True, slots=True)
class Scene:
    """A built world; from here on nothing moves but by physics."""

    world: World
    spec: EpisodeSpec
    table: int
    """Body."""
    robot: Robot
    objects: tuple[int, ...]
    """Bodies in the spec's order; the first is the target."""
    labels: NDArray[np.uint8]
    """``Label`` by [body, link + 1]."""
    cameras: Mapping[str, Camera]
    backgrounds: Mapping[str, Render]
    """What each camera sees of floor and table, which are hidden in the world itself."""

    def label_of(self, body: int, link: int) -> int:
        """Return the ``Label`` of a link."""
        return int(self.labels[body, link + 1])

    def com(self) -> Array:
        """Return the target's centre of mass (3,), world, metres."""
        return np.array(self.world.com_frame(self.objects[0])[0])


def build_scene(world: World, spec: EpisodeSpec) -> Scene:
    """Empty the world, build the scene in one fixed order and seal it.

    Raises:
        RecipeError: if an object of the recipe cannot be loaded.
        UnknownNameError: if the recipe names a robot or object that the tables do not have.
    """
    world.reset(spec.physics)
    floor, table = _add_surroundings(world)
    cameras = {
        name: make_camera(name, config, spec.resolution) for name, config in spec.cameras.items()
    }
    backgrounds = {name: _background(world, spec, camera) for name, camera in cameras.items()}
    world.hide(floor)
    world.hide(table)
    robot = Robot(world, lookup(ROBOTS, "robot", spec.robot))
    objects = tuple(_load_object(world, spec, i) for i in range(len(spec.objects)))
    world.seal()

    links = len(world.links(robot.body))
    labels = np.zeros((max(robot.body, *objects) + 1, links + 1), np.uint8)
    labels[floor], labels[table], labels[robot.body] = Label.FLOOR, Label.TABLE, Label.ARM
    labels[robot.body, robot.first_tool_link + 1 :] = Label.GRIPPER
    for i, body in enumerate(objects):
        labels[body] = Label.TARGET + i
    return Scene(
        world,
        spec,
        table,
        robot,
        objects,
        labels,
        MappingProxyType(cameras),
        MappingProxyType(backgrounds),
    )


def _add_surroundings(world: World) -> tuple[int, int]:
    """Add floor and table and return the bodies."""
    floor = world.add_box((4.0, 4.0, 0.05), (0.0, 0.0, -TABLE_HEIGHT - 0.05), FLOOR_RGBA)
    table = world.add_box(
        [side / 2.0 for side in TABLE_SIZE], (*TABLE_CENTER_XY, -TABLE_SIZE[2] / 2.0), TABLE_RGBA
    )
    for body in (floor, table):
        world.change_dynamics(
            body, -1, lateralFriction=TABLE_FRICTION, rollingFriction=TABLE_ROLLING_FRICTION
        )
    return floor, table


_backgrounds: dict[tuple[CameraConfig, tuple[int, int]], Render] = {}
"""Kept over episodes: floor and table look the same in all of them."""


def _background(world: World, spec: EpisodeSpec, camera: Camera) -> Render:
    """Return a camera's render of floor and table, the only bodies yet."""
    key = (spec.cameras[camera.name], spec.resolution)
    if key not in _backgrounds:
        if len(_backgrounds) >= MAX_BACKGROUNDS:
            _backgrounds.clear()
        _backgrounds[key] = render(world, camera)
    return _backgrounds[key]


def _load_object(world: World, spec: EpisodeSpec, i: int) -> int:
    recipe = spec.objects[i]
    model = lookup(OBJECT_SETS, "object set", recipe.object_set).model(recipe.object_id)
    if isinstance(model.body, UrdfFile):
        body = world.load_urdf(DATA / model.body.path, recipe.drop_pose, fixed=False)
    else:
        body = world.add_compound(model.body, recipe.drop_pose, mass=recipe.mass)
    world.change_dynamics(body, -1, mass=recipe.mass)
    world.change_dynamics(
        body, -1, lateralFriction=recipe.lateral_friction, spinningFriction=0.0, rollingFriction=0.0
    )
    return body


def settle(scene: Scene) -> Outcome | None:
    """Let the objects fall; return why the attempt cannot go on, or None when it can.

    Raises:
        RecipeError: if the simulation diverged.
    """
    world, physics, robot = scene.world, scene.spec.physics, scene.robot
    world.set_rate(physics.free_hz)
    home, still = robot.model.home, [0.0] * len(robot.model.home)
    robot.command(home, still, robot.model.gripper.max_width, physics.free_hz)
    window = SETTLE_CHECKS_PER_WINDOW
    steps = max(1, round(SETTLED_S / window * physics.free_hz))
    poses = [_poses(scene)]
    settled = False
    for _ in range(max(window, round(physics.settle_s * physics.free_hz / steps))):
        for _ in range(steps):
            world.step()
        poses.append(_poses(scene))
        settled = len(poses) > window and _are_close(poses[-1 - window], poses[-1])
        if settled:
            break
    com = scene.com()
    if not np.isfinite(com).all():
        raise RecipeError(f"the simulation of {scene.spec.objects[0].object_id} diverged: {com}")
    if not is_inside(com, scene.spec.workspace):
        return Outcome.LEFT_WORKSPACE
    return None if settled else Outcome.NEVER_SETTLED


def is_inside(point: Array, workspace: WorkspaceConfig) -> bool:
    """Return whether a point (3,) lies in the workspace's box."""
    return bool(np.all(point >= workspace.lower) and np.all(point <= workspace.upper))


def take_images(scene: Scene) -> dict[str, CameraImage]:
    """Render every camera."""
    return {
        name: capture(scene.world, camera, scene.backgrounds[name], scene.labels)
        for name, camera in scene.cameras.items()
    }


def observe(scene: Scene, images: Mapping[str, CameraImage]) -> SceneView:
    """Return what a policy may know."""
    return SceneView(
        images=images,
        joint_positions=scene.robot.arm_positions(),
        T_world_tcp=scene.robot.T_world_tcp(),
        gripper=scene.robot.model.gripper,
        workspace=scene.spec.workspace,
        target_label=int(Label.TARGET),
    )


def _poses(scene: Scene) -> Array:
    """Return the poses (M, 7) of the objects' centres of mass: position and quat_xyzw."""
    frames = (scene.world.com_frame(body) for body in scene.objects)
    return np.array([(*position, *quat) for position, quat in frames])


def _are_close(before: Array, after: Array) -> bool:
    """Return whether no object has moved or turned more than one at rest may."""
    way = np.linalg.norm(after[:, :3] - before[:, :3], axis=1)
    half_cosine = np.abs((before[:, 3:] * after[:, 3:]).sum(axis=1)).clip(max=1.0)
    return bool((way < SETTLED_WAY).all() and (2 * np.arccos(half_cosine) < SETTLED_TURN).all())
