"""Build, settle and render the scene of an episode: floor, table, robot and objects."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from grasp_factory.core.camera import Camera
from grasp_factory.core.config.scene import WorkspaceConfig
from grasp_factory.core.elementary import arccos
from grasp_factory.core.enums import Label, Outcome
from grasp_factory.core.episode import CameraImage, EpisodeSpec, ObjectSpec, SceneView
from grasp_factory.core.geometry import Array, Pose, inverse
from grasp_factory.core.linear import norm, product
from grasp_factory.errors import RecipeError, lookup
from grasp_factory.labels.rule import FELL_OFF
from grasp_factory.objects import UrdfFile, find_set
from grasp_factory.robots import ROBOTS
from grasp_factory.simulation.images import Render, develop
from grasp_factory.simulation.robot import Robot
from grasp_factory.simulation.static_scene import Stage, set_stage
from grasp_factory.simulation.visibility import visible_shares
from grasp_factory.simulation.world import DATA, World, put_to_sleep, wake

WHITE = (1.0, 1.0, 1.0)
"""Colour of a textured object, if neither recipe nor model has one: the texture is unchanged."""

SETTLED_WAY = 0.0003
"""Metres by which the centre of mass of a resting object may move within ``SETTLED_S``."""
SETTLED_TURN = 0.006
"""Radians by which it may turn: a point 5 cm from the centre moves by ``SETTLED_WAY``."""
SETTLED_S = 0.25
"""Seconds of the window. Displacement is the criterion, not velocity: at rest, the velocity of a
compound of hulls oscillates by several mm/s because of the solver."""
SETTLE_CHECKS_PER_WINDOW = 5


@dataclass(frozen=True, slots=True)
class Scene:
    """A complete scene; from now on, bodies move by physics alone."""

    world: World
    spec: EpisodeSpec
    stage: Stage
    robot: Robot
    objects: tuple[int, ...]
    """Bodies in the spec's order; the first is the target."""
    labels: NDArray[np.uint8]
    """``Label`` by [body, link + 1]."""

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
    stage = set_stage(world, spec)
    robot = Robot(world, lookup(ROBOTS, "robot", spec.robot))
    objects = tuple(_load_object(world, recipe) for recipe in spec.objects)
    world.seal()

    links = len(world.links(robot.body))
    labels = np.zeros((max(robot.body, *objects) + 1, links + 1), np.uint8)
    labels[stage.floor], labels[stage.table] = Label.FLOOR, Label.TABLE
    labels[robot.body] = Label.ARM
    labels[robot.body, robot.first_tool_link + 1 :] = Label.GRIPPER
    for i, body in enumerate(objects):
        labels[body] = Label.TARGET + i
    return Scene(world, spec, stage, robot, objects, labels)


def _load_object(world: World, recipe: ObjectSpec) -> int:
    model = find_set(recipe.object_set, recipe.folder_sha256).model(recipe.object_id)
    pose, mass, color = recipe.drop_pose, recipe.mass, recipe.color or model.color
    if pose is None or mass is None:
        raise RecipeError(f"{recipe.object_id} is a real object and cannot be simulated")
    if isinstance(model.body, UrdfFile):
        path = DATA / model.body.path
        scale = model.body.scale * recipe.scale
        body = world.load_urdf(path, pose, fixed=False, scale=scale)
        world.change_dynamics(body, -1, mass=mass)
    else:
        body = world.add_compound(model.body, pose, mass=mass, scale=recipe.scale)
    world.change_dynamics(
        body,
        -1,
        lateralFriction=recipe.lateral_friction,
        spinningFriction=0.0,
        rollingFriction=0.0,
        linearDamping=recipe.linear_damping,
        angularDamping=recipe.angular_damping,
    )
    if color or recipe.texture:
        world.set_look(body, color or WHITE, recipe.texture)
    return body


@dataclass(frozen=True, slots=True)
class Settled:
    """Result of the fall."""

    outcome: Outcome | None
    """The reason why an attempt is impossible; None if it is possible."""
    at_rest: NDArray[np.bool_]
    """Which objects are at rest, (M,)."""


def settle(scene: Scene) -> Settled:
    """Let the objects fall until all on the table are at rest, or until the time limit.

    If all of them are at rest, all objects are put to sleep.

    Raises:
        RecipeError: if the simulation diverged.
    """
    put_to_sleep(scene.world, [scene.robot.body])
    poses, at_rest = _fall(scene)
    wake(scene.world, [scene.robot.body])
    if _is_calm(poses, at_rest):
        put_to_sleep(scene.world, scene.objects)
    for recipe, pose in zip(scene.spec.objects, poses, strict=True):
        if not np.isfinite(pose).all():
            raise RecipeError(f"the simulation of {recipe.object_id} diverged: {pose[:3]}")
    if not is_inside(scene.com(), scene.spec.workspace):
        return Settled(Outcome.LEFT_WORKSPACE, at_rest)
    awaited = _awaited(poses, scene.spec.workspace)
    return Settled(None if at_rest[awaited].all() else Outcome.NEVER_SETTLED, at_rest)


def _fall(scene: Scene) -> tuple[Array, NDArray[np.bool_]]:
    """Step until all objects on the table are at rest, or until the time limit.

    Returns:
        The poses (M, 7) of their centres of mass, and which of them are at rest, (M,).
    """
    world, physics, robot = scene.world, scene.spec.physics, scene.robot
    world.set_stepping(physics.free)
    home, still = robot.model.home, [0.0] * len(robot.model.home)
    robot.command(home, still, robot.model.gripper.max_width, physics.free_hz)
    window = SETTLE_CHECKS_PER_WINDOW
    steps = max(1, round(SETTLED_S / window * physics.free_hz))
    poses = [_poses(scene)]
    at_rest = np.zeros(len(scene.objects), np.bool_)
    for _ in range(max(window, round(physics.settle_s * physics.free_hz / steps))):
        for _ in range(steps):
            world.step()
        poses.append(_poses(scene))
        if len(poses) > window:
            at_rest = _are_close(poses[-1 - window], poses[-1])
        if _is_calm(poses[-1], at_rest):
            break
    return poses[-1], at_rest


def _is_calm(poses: Array, at_rest: NDArray[np.bool_]) -> bool:
    """Return whether all objects on the table are at rest."""
    return bool((at_rest | (poses[:, 2] < FELL_OFF)).all())


def _awaited(poses: Array, workspace: WorkspaceConfig) -> NDArray[np.bool_]:
    """Return which objects (M,) must come to rest: the target, and those in or above the workspace.

    An object that rolls away over the table does not affect the attempt.
    """
    xy, lower, upper = poses[:, :2], workspace.lower[:2], workspace.upper[:2]
    inside = ((xy >= lower) & (xy <= upper)).all(axis=1)
    return np.asarray(inside | (np.arange(len(poses)) == 0))


def is_inside(point: Array, workspace: WorkspaceConfig) -> bool:
    """Return whether a point (3,) is inside the workspace's box."""
    return bool(np.all(point >= workspace.lower) and np.all(point <= workspace.upper))


@dataclass(frozen=True, slots=True)
class Shot:
    """An image, and ground truth about it from the simulator."""

    image: CameraImage
    visibility: NDArray[np.float32]
    """(M,): the visible share of each object's pixels in the image."""


def take_shots(scene: Scene) -> dict[str, Shot]:
    """Take an image with every camera."""
    shots = {}
    for name, (camera, whole) in render_cameras(scene).items():
        shares = visible_shares(scene.world, [scene.robot.body], scene.objects, camera, whole)
        shots[name] = Shot(develop(whole, camera, scene.labels), shares)
    return shots


def render_cameras(scene: Scene) -> dict[str, tuple[Camera, Render]]:
    """Render the images of all cameras."""
    return {name: scene.stage.look(name, scene.robot) for name in scene.spec.cameras}


def observe(scene: Scene, images: Mapping[str, CameraImage]) -> SceneView:
    """Return the input of a policy."""
    return SceneView(
        images=images,
        joint_positions=scene.robot.arm_positions(),
        T_world_tcp=scene.robot.T_world_tcp(),
        gripper=scene.robot.model.gripper,
        workspace=scene.spec.workspace,
        target_label=int(Label.TARGET),
    )


def object_frame(world: World, body: int) -> Pose:
    """Return the pose of a body's own (URDF) frame in the world; Bullet tracks its COM."""
    position, quat = world.com_frame(body)
    T_world_com = Pose(position, quat).matrix()
    return Pose.from_matrix(product(T_world_com, inverse(world.inertial_frame(body).matrix())))


def object_poses(scene: Scene) -> Array:
    """Return the poses (M, 7) of the objects' own frames: position and quat_xyzw."""
    frames = (object_frame(scene.world, body) for body in scene.objects)
    return np.array([(*frame.position, *frame.quat_xyzw) for frame in frames])


def _poses(scene: Scene) -> Array:
    """Return the poses (M, 7) of the objects' centres of mass: position and quat_xyzw."""
    frames = (scene.world.com_frame(body) for body in scene.objects)
    return np.array([(*position, *quat) for position, quat in frames])


def _are_close(before: Array, after: Array) -> NDArray[np.bool_]:
    """Return which objects (M,) moved and turned less than the limits for an object at rest."""
    way = norm(after[:, :3] - before[:, :3])
    half_cosine = np.abs((before[:, 3:] * after[:, 3:]).sum(axis=1)).clip(max=1.0)
    return np.asarray((way < SETTLED_WAY) & (2 * arccos(half_cosine) < SETTLED_TURN))
