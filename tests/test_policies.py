from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from grasp_factory.camera import Intrinsics, deproject, project
from grasp_factory.config import DEFAULT_CAMERAS, CameraConfig, WorkspaceConfig
from grasp_factory.episode import CameraImage, Grasp, SceneView
from grasp_factory.geometry import Array, apply, inverse, look_at, rotation_about, transform
from grasp_factory.gripper import Gripper
from grasp_factory.outcome import Label
from grasp_factory.policies import POLICIES
from grasp_factory.policies.base import TIP_CLEARANCE, looking_down, target_points
from grasp_factory.policies.top_down import RANKED, TopDownParameters
from grasp_factory.policies.uniform import UniformParameters
from grasp_factory.robots import ROBOTS

SIDE = CameraConfig(eye=(0.5, 0.7, 0.5), target=(0.5, 0.0, 0.05))
FRONT = DEFAULT_CAMERAS["front"]
RESOLUTION = (320, 240)
GRIPPERS = {name: model.gripper for name, model in ROBOTS.items()}
GRIPPER = GRIPPERS["kuka_iiwa"]
BRICK = (0.10, 0.04, 0.05)
"""Length along its own x, breadth and height, metres."""
PLACES = [(0.52, -0.08, 0.0), (0.55, 0.06, 0.4), (0.48, 0.0, 1.1), (0.6, 0.1, -1.3), (0.5, 0, 1.57)]
"""x, y and yaw of a brick on the table."""

Boxes = list[tuple[Array, tuple[float, float, float], int]]


def brick(x: float, y: float, yaw: float, size: tuple[float, float, float] = BRICK) -> Boxes:
    """Return one target box standing on the table."""
    T_world_box = transform(rotation_about((0.0, 0.0, 1.0), yaw), (x, y, size[2] / 2.0))
    return [(T_world_box, size, Label.TARGET)]


def entry_distance(origin: Array, rays: Array, size: tuple[float, float, float]) -> Array:
    """Return where rays (H, W, 3) enter a box about the origin, inf where they miss it."""
    half = np.array(size) / 2.0
    slow = np.where(np.abs(rays) < 1e-12, 1e-12, rays)
    to_low, to_high = (-half - origin) / slow, (half - origin) / slow
    entry = np.minimum(to_low, to_high).max(axis=-1)
    leave = np.maximum(to_low, to_high).min(axis=-1)
    return np.where((entry <= leave) & (entry > 0.0), entry, np.inf)


def photograph(camera: CameraConfig, boxes: Boxes, resolution: tuple[int, int]) -> CameraImage:
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


def make_view(
    boxes: Boxes,
    gripper: Gripper = GRIPPER,
    cameras: Mapping[str, CameraConfig] = DEFAULT_CAMERAS,
    resolution: tuple[int, int] = RESOLUTION,
) -> SceneView:
    return SceneView(
        images={name: photograph(c, boxes, resolution) for name, c in cameras.items()},
        joint_positions=np.zeros(7),
        T_world_tcp=np.eye(4),
        gripper=gripper,
        workspace=WorkspaceConfig(),
        target_label=int(Label.TARGET),
    )


def plan(policy: str, view: SceneView, seed: int = 0) -> tuple[Grasp, ...]:
    asked = POLICIES[policy]
    return asked.plan(view, np.random.default_rng(seed), asked.settings({})).grasps


def plain(grasps: tuple[Grasp, ...]) -> list[tuple[Any, ...]]:
    return [(grasp.T_world_tcp.tolist(), grasp.width, grasp.score) for grasp in grasps]


def arrays(view: SceneView) -> list[NDArray[Any]]:
    images = [getattr(image, f.name) for image in view.images.values()
              for f in dataclasses.fields(image)]  # fmt: skip
    return [*images, view.joint_positions, view.T_world_tcp]


class TestThePhotographs:
    """The oracle itself: what it draws is where it should be."""

    def test_a_corner_of_a_brick_is_seen_where_it_projects(self) -> None:
        size = (0.10, 0.04, 0.05)
        image = photograph(FRONT, brick(0.5, 0.05, 0.3), RESOLUTION)
        corners = np.array([(sx, sy, 1.0) for sx in (-1, 1) for sy in (-1, 1)]) * size / 2.0
        T_world_box = brick(0.5, 0.05, 0.3)[0][0]
        in_camera = apply(inverse(image.T_world_camera), apply(T_world_box, corners))
        pixels = project(in_camera, image.intrinsics)
        v, u = np.nonzero(image.segmentation == Label.TARGET)
        # A sharp corner may pass between two samples, so one pixel is not enough.
        assert abs(u.min() - pixels[:, 0].min()) < 1.5
        assert abs(u.max() - pixels[:, 0].max()) < 1.5
        assert abs(v.min() - pixels[:, 1].min()) < 1.5


class TestTargetPoints:
    def test_they_lie_on_the_target_as_every_camera_sees_it(self) -> None:
        boxes = [*brick(0.5, 0.0, 0.7), *[(transform(np.eye(3), (0.5, 0.15, 0.03)),
                                          (0.06, 0.06, 0.06), Label.TARGET + 1)]]  # fmt: skip
        view = make_view(boxes, cameras={"front": FRONT, "side": SIDE})
        points = target_points(view)
        counts = [(image.segmentation == Label.TARGET).sum() for image in view.images.values()]
        assert min(counts) > 0
        assert len(points) == sum(counts)
        from_faces = np.abs(apply(inverse(boxes[0][0]), points)) - np.array(BRICK) / 2.0
        np.testing.assert_allclose(from_faces.max(axis=1), 0.0, atol=1e-6)

    def test_nothing_seen_is_no_points(self) -> None:
        assert target_points(make_view([])).shape == (0, 3)

    def test_looking_down_approaches_down_and_closes_along_the_yaw(self) -> None:
        T_world_tcp = looking_down(0.1, 0.2, 0.3, math.pi / 2)
        np.testing.assert_allclose(T_world_tcp[:3, 1], [0.0, 1.0, 0.0], atol=1e-15)
        np.testing.assert_allclose(T_world_tcp[:3, 2], [0.0, 0.0, -1.0], atol=1e-15)
        np.testing.assert_allclose(T_world_tcp[:3, 3], [0.1, 0.2, 0.3])
        assert np.linalg.det(T_world_tcp) == pytest.approx(1.0)


@pytest.mark.parametrize("gripper", GRIPPERS.values(), ids=GRIPPERS)
@pytest.mark.parametrize("policy", POLICIES)
class TestPolicy:
    """Every policy of the table keeps these promises, for the gripper of every robot."""

    @pytest.fixture
    def view(self, gripper: Gripper) -> SceneView:
        return make_view(brick(0.55, 0.06, 0.4), gripper)

    def test_the_same_view_and_seed_give_the_same_plan(self, policy: str, view: SceneView) -> None:
        assert plain(plan(policy, view, 3)) == plain(plan(policy, view, 3))

    def test_the_view_is_left_alone(self, policy: str, view: SceneView) -> None:
        before = [array.copy() for array in arrays(view)]
        for array in arrays(view):
            array.flags.writeable = False
        plan(policy, view)
        for array, was in zip(arrays(view), before, strict=True):
            np.testing.assert_array_equal(array, was)

    def test_an_unseen_target_gives_an_empty_plan(self, policy: str, gripper: Gripper) -> None:
        assert plan(policy, make_view([], gripper)) == ()

    def test_a_single_pixel_of_the_target_is_enough_for_a_plan(
        self, policy: str, view: SceneView
    ) -> None:
        image = view.images["front"]
        v, u = np.argwhere(image.segmentation == Label.TARGET)[0]
        image.segmentation[image.segmentation == Label.TARGET] = Label.TABLE
        image.segmentation[v, u] = Label.TARGET
        assert plan(policy, view)

    def test_other_objects_are_not_grasped(self, policy: str, gripper: Gripper) -> None:
        other = [(T, size, Label.TARGET + 1) for T, size, _ in brick(0.5, 0.1, 0.0)]
        assert plan(policy, make_view(other, gripper)) == ()

    @pytest.mark.parametrize("height", [0.012, 0.05, 0.15])
    def test_grasps_are_downward_rigid_and_off_the_table(
        self, policy: str, gripper: Gripper, height: float
    ) -> None:
        view = make_view(brick(0.5, 0.0, 1.1, (0.08, 0.03, height)), gripper)
        for seed in range(20):
            grasps = plan(policy, view, seed)
            assert grasps
            for grasp in grasps:
                T = grasp.T_world_tcp
                np.testing.assert_allclose(T[:3, :3] @ T[:3, :3].T, np.eye(3), atol=1e-12)
                assert np.linalg.det(T[:3, :3]) == pytest.approx(1.0)
                np.testing.assert_array_equal(T[3], [0.0, 0.0, 0.0, 1.0])
                np.testing.assert_allclose(T[:3, 2], [0.0, 0.0, -1.0], atol=1e-12)
                tips = T[:3, 3] + gripper.tip_distance * T[:3, 2]
                assert tips[2] >= TIP_CLEARANCE - 1e-12
                assert 0.0 < grasp.width <= gripper.max_width
                assert math.isfinite(grasp.score)

    def test_the_best_grasp_comes_first(self, policy: str, view: SceneView) -> None:
        scores = [grasp.score for grasp in plan(policy, view)]
        assert scores == sorted(scores, reverse=True)

    def test_grasps_go_with_the_target(self, policy: str, gripper: Gripper) -> None:
        aims = []
        for y in (-0.1, 0.1):
            (first, *_) = plan(policy, make_view(brick(0.55, y, 0.4), gripper), 5)
            aims.append(first.T_world_tcp[:3, 3])
        np.testing.assert_allclose(aims[1] - aims[0], [0.0, 0.2, 0.0], atol=0.006)


@pytest.mark.parametrize("gripper", GRIPPERS.values(), ids=GRIPPERS)
class TestTopDown:
    @pytest.mark.parametrize("place", PLACES)
    def test_it_closes_across_the_narrow_side_at_the_middle(
        self, gripper: Gripper, place: tuple[float, float, float]
    ) -> None:
        x, y, yaw = place
        (best, *_) = plan("top_down", make_view(brick(x, y, yaw), gripper))
        across = np.array([-math.sin(yaw), math.cos(yaw), 0.0])
        turn = math.degrees(math.acos(min(1.0, abs(best.T_world_tcp[:3, 1] @ across))))
        assert turn < 10.0
        assert math.dist(best.T_world_tcp[:2, 3], (x, y)) < 0.005

    @pytest.mark.parametrize("place", PLACES)
    def test_the_open_gripper_clears_the_target(
        self, gripper: Gripper, place: tuple[float, float, float]
    ) -> None:
        (best, *_) = plan("top_down", make_view(brick(*place), gripper))
        assert best.width >= BRICK[1] + 2.0 * TopDownParameters().finger_clearance

    @pytest.mark.parametrize("height", [0.012, 0.05, 0.08, 0.15])
    def test_it_grasps_half_way_up_unless_the_palm_or_the_table_is_in_the_way(
        self, gripper: Gripper, height: float
    ) -> None:
        view = make_view(brick(0.5, 0.0, 0.0, (0.08, 0.03, height)), gripper)
        lowest = gripper.tip_distance + TIP_CLEARANCE
        for grasp in plan("top_down", view):
            z = grasp.T_world_tcp[2, 3]
            assert z + gripper.palm_distance > height
            if lowest < height / 2.0 < gripper.palm_distance - TIP_CLEARANCE:
                assert z == pytest.approx(height / 2.0, abs=1e-6)

    def test_what_is_too_wide_is_grasped_all_the_same(self, gripper: Gripper) -> None:
        grasps = plan("top_down", make_view(brick(0.5, 0.0, 0.0, (0.2, 0.2, 0.05)), gripper))
        assert grasps
        assert {grasp.width for grasp in grasps} == {gripper.max_width}

    def test_an_angled_target_is_grasped_where_it_is(self, gripper: Gripper) -> None:
        # The middle of an L is empty.
        bar: Boxes = [(transform(np.eye(3), (0.5, -0.03, 0.02)), (0.10, 0.03, 0.04), Label.TARGET)]
        leg: Boxes = [(transform(np.eye(3), (0.465, 0.02, 0.02)), (0.03, 0.07, 0.04), Label.TARGET)]
        (best, *_) = plan("top_down", make_view([*bar, *leg], gripper))
        away = [
            (np.abs(best.T_world_tcp[:2, 3] - T[:2, 3]) - np.array(size[:2]) / 2.0).max()
            for T, size, _ in [*bar, *leg]
        ]
        assert min(away) < -0.01

    def test_it_draws_nothing(self, gripper: Gripper) -> None:
        view = make_view(brick(*PLACES[1]), gripper)
        assert plain(plan("top_down", view, 1)) == plain(plan("top_down", view, 2))

    def test_it_proposes_a_handful(self, gripper: Gripper) -> None:
        assert len(plan("top_down", make_view(brick(*PLACES[1]), gripper))) == RANKED


class TestUniform:
    def test_aim_yaw_and_depth_spread_evenly_over_their_ranges(self) -> None:
        view = make_view(brick(0.5, 0.0, 0.0, (0.10, 0.04, 0.08)), resolution=(160, 120))
        points = target_points(view)
        grasps = [grasp for seed in range(2000) for grasp in plan("uniform", view, seed)]
        assert len(grasps) == 2000
        T = np.stack([grasp.T_world_tcp for grasp in grasps])
        aim = T[:, :2, 3] - (points.min(axis=0) + points.max(axis=0))[:2] / 2.0
        yaw = np.arctan2(T[:, 1, 1], T[:, 0, 1])
        noise, deepest = UniformParameters().aim_noise, GRIPPER.tip_distance + TIP_CLEARANCE
        for values, low, high in (
            (aim[:, 0], -noise, noise),
            (aim[:, 1], -noise, noise),
            (yaw, -math.pi / 2, math.pi / 2),
            (T[:, 2, 3], deepest, points[:, 2].max()),
        ):
            assert low - 1e-12 <= values.min() <= values.max() <= high + 1e-12
            counts, _ = np.histogram(values, bins=10, range=(low, high))
            chi_square = ((counts - 200.0) ** 2 / 200.0).sum()
            assert chi_square < 27.9  # nine degrees of freedom: exceeded once in a thousand

    def test_the_gripper_is_fully_open(self) -> None:
        (grasp,) = plan("uniform", make_view(brick(*PLACES[0])))
        assert grasp.width == GRIPPER.max_width

    def test_a_flat_target_is_grasped_as_deep_as_the_table_allows(self) -> None:
        view = make_view(brick(0.5, 0.0, 0.0, (0.08, 0.03, 0.012)))
        for seed in range(20):
            (grasp,) = plan("uniform", view, seed)
            assert grasp.T_world_tcp[2, 3] == GRIPPER.tip_distance + TIP_CLEARANCE


class TestTable:
    def test_policies_are_listed_by_their_name_and_described(self) -> None:
        for name, policy in POLICIES.items():
            assert policy.name == name
            assert policy.description
