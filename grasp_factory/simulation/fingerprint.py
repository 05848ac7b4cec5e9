"""The fingerprint of the platform that this process runs on, measured in some tens of ms."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Iterable
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from grasp_factory.core import elementary, geometry, linear
from grasp_factory.core.camera import Camera, Intrinsics, Light
from grasp_factory.core.config.factory_config import FactoryConfig
from grasp_factory.core.config.physics import PhysicsConfig
from grasp_factory.core.geometry import Pose
from grasp_factory.core.platforms import Fingerprint
from grasp_factory.core.renderer import Renderer
from grasp_factory.policies.networks.known_answers import known_log_odds
from grasp_factory.simulation.world import DATA, World

PHYSICS = PhysicsConfig(free_hz=240, solver_iterations=50, gravity=9.81)
"""Fixed values, because the defaults may change."""
STEPS = 240
BOXES = 5
ARM = DATA / "pendulum5.urdf"
"""Five links on revolute joints, which fall among the boxes."""
ARGUMENTS = 4000
"""Number of arguments for each C library function: FMA changes one result in a thousand."""
DIGITS = 8

Numbers = Iterable[float]


def fingerprint(config: FactoryConfig) -> Fingerprint:
    """Return this platform's fingerprint for the episodes of a config.

    It is measured once per process and renderer.

    Raises:
        UsageError: if the config's renderer cannot be loaded here.
        GraspFactoryError: if the renderer is egl, and a world of this process already uses OpenGL.
    """
    measured = _measured(config.renderer)
    return replace(measured, network=_network()) if config.models else measured


@cache
def _network() -> str:
    return _digest_of(known_log_odds())


@cache
def _measured(renderer: Renderer) -> Fingerprint:
    with World(renderer) as world:
        bodies, arm = _build(world)
        images = _images(world, renderer)
        engine = _digest(_tumble(world, bodies, arm))
    return Fingerprint(
        engine=engine, images=images, libm=_digest(_libm()), arithmetic=_arithmetic()
    )


def _build(world: World) -> tuple[list[int], int]:
    """Add a floor, and boxes and a chain of links above it; return the boxes and the chain."""
    world.reset(PHYSICS)
    world.add_box((1.0, 1.0, 0.05), (0.0, 0.0, -0.05), (0.5, 0.5, 0.5, 1.0))
    boxes = [
        world.add_box(
            (0.04, 0.05 + 0.01 * i, 0.06),
            (0.03 * i, 0.02 * i - 0.3, 0.2 + 0.15 * i),
            (0.9, 0.1 * i, 0.2, 1.0),
            mass=0.2 + 0.1 * i,
        )
        for i in range(BOXES)
    ]
    turned = Pose((0.0, -0.6, 0.55), (0.2, 0.3, 0.1, math.sqrt(0.86)))
    return boxes, world.load_urdf(ARM, turned, fixed=True)


def _tumble(world: World, boxes: list[int], arm: int) -> Numbers:
    """Let all bodies fall and yield their states after each step: contacts amplify differences."""
    joints = list(world.joints(arm).values())
    world.command_velocities(arm, joints, [0.0] * len(joints), [0.02] * len(joints))
    for _ in range(STEPS):
        world.step()
        for box in boxes:
            for part in world.com_frame(box):
                yield from part
        for state in world.joint_states(arm, joints):
            yield from state[:2]


def _images(world: World, renderer: Renderer) -> str:
    intrinsics = Intrinsics.from_fov(48, 36, 1.0, renderer)
    pose = geometry.look_at((1.2, 0.5, 0.9), (0.0, 0.0, 0.2))
    camera = Camera("fingerprint", intrinsics, pose, 0.1, 3.0, renderer)
    rgb, zbuffer, segmentation = world.render(camera, Light())
    return _digest_of(rgb, zbuffer, segmentation)


def _libm() -> Numbers:
    """Yield values of the functions of the C library that the engine calls."""
    for k in range(ARGUMENTS):
        x, y = (k * 7919 % 10007 / 10007.0, k * 6007 % 9973 / 9973.0)  # in [0, 1)
        wide, near = 20.0 * x - 10.0, 2.0 * x - 1.0
        yield from (math.sin(wide), math.cos(wide), math.tan(wide))
        yield from (math.asin(near), math.acos(near), math.atan2(wide, 2.0 * y - 1.0))
        yield from (math.exp(wide), math.log(x + 1e-3), math.pow(x + 0.5, 8.0 * y))
        yield math.fmod(100.0 * wide, y + 0.1)


def _arithmetic() -> str:
    """Return the digest of results of the numpy and package routines that make episodes."""
    k = np.arange(64, dtype=np.float64)
    a, b = k * 0.37 - 9.1, k * 0.11 + 0.7
    rng = np.random.default_rng(np.random.SeedSequence(5, spawn_key=(7, 1)))
    return _digest_of(
        *(a + b, a - b, a * b, a / b, np.sqrt(b)),
        *(rng.uniform(-2.0, 3.0, 64), rng.integers(0, 1000, 64)),
        *elementary.sincos(a),
        *(elementary.arctan2(a, b), elementary.exp(a), elementary.log(b)),
        *(elementary.arccos(k / 64.0), elementary.normal(rng, 64)),
        *_transforms(),
        *_solutions(),
    )


def _solutions() -> Iterable[NDArray[Any]]:
    A = np.arange(36.0).reshape(6, 6) % 7.0 / 7.0
    definite = linear.product(A, A.T) + np.eye(6)
    yield from (definite, linear.solve_definite(definite, A[0]), linear.norm(A))


def _transforms() -> Iterable[NDArray[Any]]:
    axis = np.array([0.48, 0.6, 0.64])
    for k in range(8):
        R = geometry.rotation_about(axis, 0.9 * k - 3.0)
        T = geometry.transform(R, (0.1 * k, 0.3, -0.2 * k))
        yield from (T, geometry.inverse(T), geometry.matrix_to_quat_xyzw(R))
        yield Pose.from_matrix(T).matrix()
        yield geometry.rotation_vector(R)


def _digest(numbers: Numbers) -> str:
    return _digest_of(np.fromiter(numbers, np.float64))


def _digest_of(*arrays: NDArray[Any]) -> str:
    digest = hashlib.sha256()
    for array in arrays:
        little = array.astype(array.dtype.newbyteorder("<"))
        digest.update(np.ascontiguousarray(little).tobytes())
    return digest.hexdigest()[:DIGITS]
