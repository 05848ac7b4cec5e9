"""Views of boxes on the table, computed ray by ray: what a policy sees, without a simulator."""

from __future__ import annotations

import math
from collections.abc import Mapping
from types import MappingProxyType

import numpy as np

from grasp_factory.core.camera import Intrinsics, deproject
from grasp_factory.core.config.cameras import CAMERAS, CameraConfig
from grasp_factory.core.config.scene import WorkspaceConfig
from grasp_factory.core.enums import Label
from grasp_factory.core.episode import CameraImage, Grasp, SceneView
from grasp_factory.core.geometry import Array, apply, inverse, look_at, rotation_about, transform
from grasp_factory.core.gripper import Gripper

FRONT = CAMERAS["front"].config
RESOLUTION = (320, 240)
BRICK = (0.10, 0.04, 0.05)
"""Length along its own x, breadth and height, metres."""

PlacedBoxes = list[tuple[Array, tuple[float, float, float], int]]
"""Pose in the world frame (4, 4), sides in metres and label of each box."""


def brick(x: float, y: float, yaw: float, size: tuple[float, float, float] = BRICK) -> PlacedBoxes:
    """Return one target box standing on the table."""
    T_world_box = transform(rotation_about((0.0, 0.0, 1.0), yaw), (x, y, size[2] / 2.0))
    return [(T_world_box, size, Label.TARGET)]


def make_view(
    boxes: PlacedBoxes,
    gripper: Gripper,
    cameras: Mapping[str, CameraConfig] = MappingProxyType({"front": FRONT}),
    resolution: tuple[int, int] = RESOLUTION,
) -> SceneView:
    """Return what cameras see of boxes on the table."""
    return SceneView(
        images={name: photograph(c, boxes, resolution) for name, c in cameras.items()},
        joint_positions=np.zeros(7),
        T_world_tcp=np.eye(4),
        gripper=gripper,
        workspace=WorkspaceConfig(),
        target_label=int(Label.TARGET),
    )


def photograph(
    camera: CameraConfig, boxes: PlacedBoxes, resolution: tuple[int, int]
) -> CameraImage:
    """Return what a pinhole sees of boxes on the table: every pixel's ray, met with each."""
    width, height = resolution
    K = Intrinsics.from_fov(width, height, math.radians(camera.fov_y_deg)).matrix()
    T_world_camera = look_at(camera.eye, camera.target, camera.up)
    rays = deproject(np.ones((height, width)), K)  # depth 1: lengths along a ray are depths
    down = rays @ T_world_camera[2, :3]
    depth = np.where(down < 0.0, -T_world_camera[2, 3] / np.minimum(down, -1e-12), camera.far)
    labels = np.where(down < 0.0, Label.TABLE, Label.BACKGROUND)
    for T_world_box, size, label in boxes:
        T_box_camera = inverse(T_world_box) @ T_world_camera
        entry = entry_distance(T_box_camera[:3, 3], rays @ T_box_camera[:3, :3].T, size)
        labels = np.where(entry < depth, label, labels)
        depth = np.minimum(entry, depth)
    return CameraImage(
        rgb=np.zeros((height, width, 3), np.uint8),
        depth=np.minimum(depth, camera.far).astype(np.float32),
        segmentation=labels.astype(np.uint8),
        intrinsics=K,
        T_world_camera=T_world_camera,
    )


def entry_distance(origin: Array, rays: Array, size: tuple[float, float, float]) -> Array:
    """Return where rays (H, W, 3) enter a box about the origin, inf where they miss it."""
    half = np.array(size) / 2.0
    slow = np.where(np.abs(rays) < 1e-12, 1e-12, rays)
    to_low, to_high = (-half - origin) / slow, (half - origin) / slow
    entry = np.minimum(to_low, to_high).max(axis=-1)
    leave = np.maximum(to_low, to_high).min(axis=-1)
    return np.where((entry <= leave) & (entry > 0.0), entry, np.inf)


def lowest_corner(grasp: Grasp, gripper: Gripper) -> float:
    """Return the height of the open fingers' lowest corner, metres."""
    corners = [
        (sx * gripper.pad_size[0] / 2, sy * (grasp.width / 2 + gripper.finger_thickness))
        for sx in (-1, 1)
        for sy in (-1, 1)
    ]
    tips = np.array([(*corner, gripper.tip_distance) for corner in corners])
    return float(apply(grasp.T_world_tcp, tips)[:, 2].min())


def tilt_deg(grasp: Grasp) -> float:
    """Return the angle between a grasp's approach and straight down, degrees."""
    return math.degrees(math.acos(min(1.0, -grasp.T_world_tcp[2, 2])))
