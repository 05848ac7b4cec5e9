"""The contract of a named camera, which every row of ``CAMERAS`` keeps.

- What it looks at lies in the middle of its image and within its clipping range.
- A camera that is fixed to the world sees every place where objects may be dropped.
- A camera on the hand sees the space between the fingertips of every robot.
"""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest

from grasp_factory.core.camera import Intrinsics, project
from grasp_factory.core.config.cameras import CAMERAS, CameraConfig, Mount
from grasp_factory.core.config.scene import WorkspaceConfig
from grasp_factory.core.geometry import Array, apply, inverse, look_at
from grasp_factory.robots import ROBOTS

WIDTH, HEIGHT = 640, 480


def seen(camera: CameraConfig, points: Array) -> tuple[Array, Array]:
    """Return pixels (K, 2) and depths (K,), metres, of points in the frame of a camera's mount."""
    T_mount_camera = look_at(camera.eye, camera.target, camera.up)
    in_camera = apply(inverse(T_mount_camera), points)
    K = Intrinsics.from_fov(WIDTH, HEIGHT, math.radians(camera.fov_y_deg)).matrix()
    return project(in_camera, K), in_camera[:, 2]


def are_seen(camera: CameraConfig, points: Array) -> bool:
    pixels, depth = seen(camera, points)
    inside = (pixels >= 0.0) & (pixels < (WIDTH, HEIGHT))
    return bool(inside.all() and ((camera.near < depth) & (depth < camera.far)).all())


@pytest.mark.parametrize("name", CAMERAS)
def test_what_it_looks_at_is_in_the_middle(name: str) -> None:
    camera = CAMERAS[name].config
    pixels, _ = seen(camera, np.array([camera.target]))
    assert pixels[0] == pytest.approx([WIDTH / 2, HEIGHT / 2], abs=1.0)
    assert are_seen(camera, np.array([camera.target]))


@pytest.mark.parametrize("name", [n for n, c in CAMERAS.items() if c.config.mount is Mount.WORLD])
def test_one_that_stands_sees_where_objects_are_dropped(name: str) -> None:
    box = WorkspaceConfig()
    sides = [(box.lower[i] + box.margin, box.upper[i] - box.margin) for i in range(2)]
    corners = np.array(list(itertools.product(*sides, (0.0,))))
    assert are_seen(CAMERAS[name].config, corners)


@pytest.mark.parametrize("robot", ROBOTS)
@pytest.mark.parametrize("name", [n for n, c in CAMERAS.items() if c.config.mount is Mount.TCP])
def test_one_on_the_hand_sees_between_the_fingertips(name: str, robot: str) -> None:
    tip = ROBOTS[robot].gripper.tip_distance
    assert are_seen(CAMERAS[name].config, np.array([(0.0, 0.0, tip)]))
