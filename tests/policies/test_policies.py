from __future__ import annotations

import math
import re
import sys
from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest
from support.views import (
    BRICK,
    FRONT,
    GRIPPER,
    GRIPPERS,
    RESOLUTION,
    PlacedBoxes,
    brick,
    lowest_corner,
    make_view,
    photograph,
    plain,
    plan,
    tilt_deg,
)

from grasp_factory.core.camera import project
from grasp_factory.core.config.cameras import CameraConfig
from grasp_factory.core.enums import Label
from grasp_factory.core.episode import Grasp, GraspPlan
from grasp_factory.core.geometry import (
    Array,
    apply,
    inverse,
    rotation_about,
    rotation_vector,
    transform,
)
from grasp_factory.core.gripper import Gripper
from grasp_factory.core.serialization import to_plain
from grasp_factory.errors import ConfigError
from grasp_factory.policies import POLICIES
from grasp_factory.policies.base import (
    TIP_CLEARANCE,
    Policy,
    PolicyError,
    checked_plan,
    looking_down,
    target_points,
)
from grasp_factory.policies.closing_outcome import POINT_SIZE, Grip, close_on
from grasp_factory.policies.direct import DIRECT
from grasp_factory.policies.occupied_columns import SolidColumns
from grasp_factory.policies.surface import Surface, outline, seen_surface
from grasp_factory.policies.top_down import RANKED, TopDownParameters
from grasp_factory.policies.uniform import UniformParameters

SIDE = CameraConfig(eye=(0.5, 0.7, 0.5), target=(0.5, 0.0, 0.05))
PLACES = [(0.52, -0.08, 0.0), (0.55, 0.06, 0.4), (0.48, 0.0, 1.1), (0.6, 0.1, -1.3), (0.5, 0, 1.57)]
"""x, y and yaw of a brick on the table."""
LEANING: PlacedBoxes = [
    (
        transform(
            rotation_about((0.0, 0.0, 1.0), 1.57) @ rotation_about((1.0, 0.0, 0.0), -0.35),
            (0.52, 0.0, 0.06),
        ),
        (0.12, 0.03, 0.09),
        Label.TARGET,
    )
]
"""A plate that leans away from the front camera by 20 degrees, so that its face looks up."""


def disc(x: float, y: float, radius: float, height: float) -> PlacedBoxes:
    """Return a standing cylinder as a prism of 32 sides: boxes between its opposite sides."""
    size = (2.0 * radius, 2.0 * radius * math.tan(math.pi / 32), height)
    return [brick(x, y, i * math.pi / 16, size)[0] for i in range(16)]


def hand(gripper: Gripper, width: float) -> list[tuple[Array, Array]]:
    """Return the open fingers and a palm as wide as they are: corners (3,), TCP frame."""
    x, inner, outer = gripper.pad_size[0] / 2, width / 2, width / 2 + gripper.finger_thickness
    palm, tip = -gripper.palm_distance, gripper.tip_distance
    return [
        (np.array([-x, inner, palm]), np.array([x, outer, tip])),
        (np.array([-x, -outer, palm]), np.array([x, -inner, tip])),
        (np.array([-x, -outer, palm - 0.05]), np.array([x, outer, palm])),
    ]


def filled(boxes: PlacedBoxes) -> Array:
    """Return points (N, 3) 2 mm apart that fill boxes, world frame."""
    clouds = []
    for T_world_box, size, _ in boxes:
        axes = [np.linspace(-s / 2, s / 2, math.ceil(s / 0.002) + 1) for s in size]
        grid = np.stack(np.meshgrid(*axes), axis=-1).reshape(-1, 3)
        clouds.append(apply(T_world_box, grid))
    return np.vstack(clouds)


def overlaps(grasp: Grasp, gripper: Gripper, boxes: PlacedBoxes) -> bool:
    points = apply(inverse(grasp.T_world_tcp), filled(boxes))
    return any(
        bool(((points > low) & (points < high)).all(axis=1).any())
        for low, high in hand(gripper, grasp.width)
    )


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

    @pytest.mark.slow
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
        bar: PlacedBoxes = [
            (transform(np.eye(3), (0.5, -0.03, 0.02)), (0.10, 0.03, 0.04), Label.TARGET)
        ]
        leg: PlacedBoxes = [
            (transform(np.eye(3), (0.465, 0.02, 0.02)), (0.03, 0.07, 0.04), Label.TARGET)
        ]
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


class TestWhatTheImageTells:
    """Normals, outline and solid, against the brick that was photographed."""

    @pytest.mark.parametrize("place", PLACES)
    def test_seen_normals_are_those_of_the_faces(self, place: tuple[float, float, float]) -> None:
        boxes = brick(*place)
        seen = seen_surface(make_view(boxes))
        T_box_world = inverse(boxes[0][0])
        depth = np.abs(apply(T_box_world, seen.points)) - np.array(BRICK) / 2.0
        normals = seen.normals @ T_box_world[:3, :3].T
        inside = np.sort(depth, axis=1)[:, 1] < -0.010  # away from the edges
        assert inside.sum() > 100
        on_face = np.take_along_axis(normals, depth.argmax(axis=1)[:, None], axis=1)[inside, 0]
        side = np.take_along_axis(
            apply(T_box_world, seen.points), depth.argmax(axis=1)[:, None], axis=1
        )[inside, 0]
        assert (on_face * np.sign(side)).min() > 0.999

    @pytest.mark.parametrize("place", PLACES)
    def test_walls_below_the_outline_are_the_unseen_faces(
        self, place: tuple[float, float, float]
    ) -> None:
        boxes = brick(*place)
        view = make_view(boxes, resolution=(640, 480))
        walls = outline(view)
        T_box_world = inverse(boxes[0][0])
        points = apply(T_box_world, walls.points)
        normals = walls.normals @ T_box_world[:3, :3].T
        depth = np.abs(points[:, :2]) - np.array(BRICK[:2]) / 2.0
        away = depth.min(axis=1) < -0.006  # from the corners
        assert away.sum() > 20
        assert depth.max(axis=1)[away].min() > -0.003
        face = depth.argmax(axis=1)[:, None]
        along = np.take_along_axis(normals[:, :2] * np.sign(points[:, :2]), face, axis=1)[away, 0]
        assert np.median(along) > 0.99
        assert (along > math.cos(math.radians(20.0))).mean() > 0.9
        np.testing.assert_allclose(np.linalg.norm(walls.normals, axis=1), 1.0)
        assert not walls.normals[:, 2].any()

    def test_where_the_target_stands_on_the_table_there_is_no_outline(self) -> None:
        assert outline(make_view(brick(*PLACES[1]))).points[:, 2].min() > 0.004

    def test_what_stands_before_the_target_draws_no_outline(self) -> None:
        before: PlacedBoxes = [(transform(np.eye(3), (0.62, 0.0, 0.03)), (0.02, 0.3, 0.06), 6)]
        target = brick(0.5, 0.0, 1.57)
        free, hidden = outline(make_view(target)), outline(make_view([*target, *before]))
        assert 0 < len(hidden) <= len(free)
        away = np.linalg.norm(hidden.points[:, None] - free.points[None], axis=2).min(axis=1)
        assert away.max() < 0.003

    @pytest.mark.parametrize("place", PLACES)
    def test_the_solid_has_the_bricks_centroid(self, place: tuple[float, float, float]) -> None:
        solid = SolidColumns.under(target_points(make_view(brick(*place))))
        middle = (*place[:2], BRICK[2] / 2.0)
        np.testing.assert_allclose(solid.centroid(), middle, atol=0.003)
        assert solid.points()[:, 2].min() < 0.01
        assert solid.points()[:, 2].max() == pytest.approx(BRICK[2], abs=1e-6)


class TestClosing:
    """What the pads of a downward grasp at the origin meet, closing along y."""

    T_WORLD_TCP = looking_down(0.0, 0.0, 0.0, math.pi / 2.0)

    @staticmethod
    def wedge(slope_deg: float) -> Surface:
        """Return two faces at y = -0.01 and 0.03 m, the latter leaning about the vertical."""
        x, z = np.meshgrid(np.linspace(-0.03, 0.03, 61), np.linspace(-0.005, 0.005, 11))
        flat = np.stack([x.ravel(), np.full(x.size, -0.01), z.ravel()], axis=1)
        slope = math.radians(slope_deg)
        leaning = (
            flat * (1, 0, 1) + (0, 0.03, 0) + np.outer(flat[:, 0] * -math.tan(slope), (0, 1, 0))
        )
        normals = np.repeat([[0.0, -1.0, 0.0], [math.sin(slope), math.cos(slope), 0.0]], x.size, 0)
        return Surface(np.vstack([flat, leaning]), normals)

    def met(self, surface: Surface) -> Grip:
        grip = close_on(surface, self.T_WORLD_TCP, GRIPPER)
        assert grip is not None
        return grip

    def test_two_parallel_faces(self) -> None:
        grip = self.met(self.wedge(0.0))
        assert grip.span == pytest.approx(0.04)
        assert grip.shift == pytest.approx(0.01)
        assert grip.angle == pytest.approx(0.0, abs=1e-6)
        assert grip.size == pytest.approx((0.02 + POINT_SIZE) * (0.01 + POINT_SIZE))
        np.testing.assert_allclose(grip.middle, [0.0, 0.01, 0.0], atol=1e-9)

    def test_a_leaning_face_has_its_angle_and_is_met_at_its_foremost_edge(self) -> None:
        grip = self.met(self.wedge(25.0))
        assert math.degrees(grip.angle) == pytest.approx(25.0)
        assert grip.span == pytest.approx(0.04 + 0.01 * math.tan(math.radians(25.0)))
        assert grip.size < self.met(self.wedge(0.0)).size / 2.0
        assert grip.middle[0] < -0.002

    def test_the_shift_centres_the_grasp(self) -> None:
        T = self.T_WORLD_TCP.copy()
        T[:3, 3] += self.met(self.wedge(0.0)).shift * T[:3, 1]
        centred = close_on(self.wedge(0.0), T, GRIPPER)
        assert centred is not None
        assert centred.shift == pytest.approx(0.0, abs=1e-9)

    def test_one_face_alone_is_no_grip(self) -> None:
        both = self.wedge(0.0)
        one = both.where(both.points[:, 1] < 0.0)
        assert close_on(one, self.T_WORLD_TCP, GRIPPER) is None
        assert close_on(both.where(both.points[:, 1] > 1.0), self.T_WORLD_TCP, GRIPPER) is None


@pytest.mark.parametrize("gripper", GRIPPERS.values(), ids=GRIPPERS)
class TestAntipodal:
    @pytest.mark.parametrize("place", PLACES)
    @pytest.mark.parametrize("friction", [0.2, 0.5])
    def test_it_closes_on_opposite_faces_within_the_friction_cone(
        self, gripper: Gripper, place: tuple[float, float, float], friction: float
    ) -> None:
        boxes = brick(*place)
        for grasp in plan("antipodal", make_view(boxes, gripper), friction=friction):
            assert grasp.proposer == ""
            T_box_tcp = inverse(boxes[0][0]) @ grasp.T_world_tcp
            closing, origin = T_box_tcp[:3, 1], T_box_tcp[:3, 3]
            assert abs(closing[1]) >= math.cos(math.atan(friction)) - 0.01  # only y fits
            for face in (-1, 1):
                at = origin + closing * (face * BRICK[1] / 2.0 - origin[1]) / closing[1]
                assert abs(at[0]) < BRICK[0] / 2.0
                assert abs(at[2]) < BRICK[2] / 2.0 + gripper.pad_size[1] / 2.0

    @pytest.mark.slow
    @pytest.mark.parametrize("place", PLACES)
    @pytest.mark.parametrize("height", [0.03, 0.05, 0.12])
    def test_the_open_gripper_clears_the_target(
        self, gripper: Gripper, place: tuple[float, float, float], height: float
    ) -> None:
        boxes = brick(*place, size=(*BRICK[:2], height))
        grasps = plan("antipodal", make_view(boxes, gripper))
        assert {grasp.proposer for grasp in grasps} == {""}
        assert not [grasp for grasp in grasps if overlaps(grasp, gripper, boxes)]

    @pytest.mark.slow
    @pytest.mark.parametrize("radius", [0.015, 0.03])
    @pytest.mark.parametrize("height", [0.04, 0.10])
    def test_it_closes_across_the_axis_of_a_cylinder(
        self, gripper: Gripper, radius: float, height: float
    ) -> None:
        boxes = disc(0.53, 0.04, radius, height)
        for grasp in plan("antipodal", make_view(boxes, gripper)):
            assert grasp.proposer == ""
            T = grasp.T_world_tcp
            level = T[:2, 1] / np.linalg.norm(T[:2, 1])
            offset = np.array([0.53, 0.04]) - T[:2, 3]
            miss = abs(float(offset[0] * level[1] - offset[1] * level[0]))
            assert miss < radius * math.sin(math.atan(0.5)) + 0.003
            assert not overlaps(grasp, gripper, boxes)

    @pytest.mark.parametrize("limit", [0.0, 10.0, 30.0])
    def test_it_tilts_no_farther_than_it_may(self, gripper: Gripper, limit: float) -> None:
        grasps = plan("antipodal", make_view(LEANING, gripper), tilt_deg=limit)
        assert max(tilt_deg(grasp) for grasp in grasps) <= limit + 1e-4

    def test_it_tilts_with_a_target_that_leans(self, gripper: Gripper) -> None:
        # No level axis lies within 16.7 degrees of the seen face, which leans by 20.
        grasps = plan("antipodal", make_view(LEANING, gripper), friction=0.3)
        assert {grasp.proposer for grasp in grasps} == {""}
        for grasp in grasps:
            across = abs(float(grasp.T_world_tcp[:3, 1] @ LEANING[0][0][:3, 1]))
            assert math.degrees(math.acos(min(1.0, across))) < 17.0
            assert tilt_deg(grasp) > 3.0

    def test_a_neighbour_is_left_alone(self, gripper: Gripper) -> None:
        target = brick(0.52, 0.0, 0.0, (0.12, 0.035, 0.05))
        place = transform(np.eye(3), (0.55, 0.04, 0.03))
        other: PlacedBoxes = [(place, (0.06, 0.02, 0.06), Label.TARGET + 1)]
        (alone, *_) = plan("antipodal", make_view(target, gripper))
        assert overlaps(alone, gripper, other)  # else the neighbour proves nothing
        grasps = plan("antipodal", make_view([*target, *other], gripper))
        assert {grasp.proposer for grasp in grasps} == {""}
        assert not [grasp for grasp in grasps if overlaps(grasp, gripper, other)]

    def test_what_has_no_antipodal_grasp_is_left_to_top_down(self, gripper: Gripper) -> None:
        view = make_view(brick(0.5, 0.0, 0.0, (0.2, 0.2, 0.05)), gripper)
        grasps = plan("antipodal", view)
        assert {grasp.proposer for grasp in grasps} == {"top_down"}
        assert plain(grasps) == plain(plan("top_down", view))

    @pytest.mark.parametrize("place", PLACES)
    def test_the_target_lies_midway_between_the_open_pads(
        self, gripper: Gripper, place: tuple[float, float, float]
    ) -> None:
        boxes = brick(*place)
        view = make_view(boxes, gripper, resolution=(640, 480))
        for grasp in plan("antipodal", view, friction=0.1):
            across = apply(inverse(boxes[0][0]), grasp.T_world_tcp[None, :3, 3])[0, 1]
            assert abs(across) < 0.004

    def test_it_draws_nothing(self, gripper: Gripper) -> None:
        view = make_view(brick(*PLACES[1]), gripper)
        assert plain(plan("antipodal", view, 1)) == plain(plan("antipodal", view, 2))

    def test_a_second_camera_does_no_harm(self, gripper: Gripper) -> None:
        boxes = brick(*PLACES[2])
        view = make_view(boxes, gripper, cameras={"front": FRONT, "side": SIDE})
        for grasp in plan("antipodal", view):
            assert grasp.proposer == ""
            assert not overlaps(grasp, gripper, boxes)


def test_antipodal_settings_say_what_is_valid() -> None:
    with pytest.raises(ConfigError) as caught:
        POLICIES["antipodal"].settings({"tilt_deg": 80.0})
    assert str(caught.value) == (
        "policy_parameters.antipodal.tilt_deg: got 80.0, valid: 0.0 to 45.0 degrees"
    )


class TestPerturbed:
    VIEW = make_view(brick(*PLACES[1]), resolution=(160, 120))

    @pytest.mark.parametrize("base", DIRECT)
    def test_without_noise_it_is_the_base(self, base: str) -> None:
        silent = plan("perturbed", self.VIEW, 4, base=base, position_sigma=0, rotation_sigma_deg=0)
        asked = plan(base, self.VIEW, 4)
        assert {grasp.proposer for grasp in silent} == {base}
        assert len(silent) == len(asked)
        for one, other in zip(silent, asked, strict=True):
            np.testing.assert_allclose(one.T_world_tcp, other.T_world_tcp, atol=1e-12)
            assert (one.width, one.score) == (other.width, other.score)

    def test_the_noise_has_the_chosen_spread(self) -> None:
        high = make_view(brick(0.5, 0.0, 0.3, (0.08, 0.03, 0.4)), resolution=(160, 120))
        bases = plan("top_down", high)
        moves, turns = [], []
        for seed in range(100):
            grasps = plan("perturbed", high, seed, position_sigma=0.004, rotation_sigma_deg=3.0)
            for grasp, base in zip(grasps, bases, strict=True):
                moves.append(grasp.T_world_tcp[:3, 3] - base.T_world_tcp[:3, 3])
                turns.append(
                    rotation_vector(base.T_world_tcp[:3, :3].T @ grasp.T_world_tcp[:3, :3])
                )
        np.testing.assert_allclose(np.std(moves, axis=0), 0.004, rtol=0.1)
        np.testing.assert_allclose(np.std(turns, axis=0), math.radians(3.0), rtol=0.1)
        np.testing.assert_allclose(np.mean(moves, axis=0), 0.0, atol=0.0006)

    def test_the_tips_stay_off_the_table_for_any_noise(self) -> None:
        flat = make_view(brick(0.5, 0.0, 0.0, (0.08, 0.03, 0.012)), resolution=(160, 120))
        for seed in range(50):
            for grasp in plan("perturbed", flat, seed, position_sigma=0.1, rotation_sigma_deg=30.0):
                assert lowest_corner(grasp, GRIPPER) >= TIP_CLEARANCE - 1e-12

    @pytest.mark.parametrize("base", ["perturbed", "mixture", "topdown"])
    def test_it_builds_on_policies_that_look_for_themselves(self, base: str) -> None:
        with pytest.raises(ConfigError) as caught:
            POLICIES["perturbed"].settings({"base": base})
        assert str(caught.value) == (
            f"policy_parameters.perturbed.base: got {base!r}, valid: {', '.join(DIRECT)}"
        )

    def test_the_recipe_holds_the_bases_settings_too(self) -> None:
        settings = POLICIES["perturbed"].settings(
            {"base": "uniform", "base_parameters": {"aim_noise": 0}}
        )
        assert to_plain(settings)["base_parameters"] == {"aim_noise": 0.0}
        recipe = to_plain(POLICIES["perturbed"].settings({}))
        assert recipe["base_parameters"] == to_plain(TopDownParameters())
        assert to_plain(POLICIES["perturbed"].settings(recipe)) == recipe

    def test_a_wrong_setting_of_the_base_is_named(self) -> None:
        with pytest.raises(ConfigError) as caught:
            POLICIES["perturbed"].settings({"base_parameters": {"finger_clearence": 0.01}})
        assert str(caught.value) == (
            "policy_parameters.perturbed.base_parameters: unknown key 'finger_clearence';"
            " did you mean 'finger_clearance'? (valid: finger_clearance, opening_margin)"
        )


class TestMixture:
    VIEW = make_view(brick(*PLACES[1]), resolution=(160, 120))

    def test_it_draws_by_weight(self) -> None:
        weights = {"uniform": 3.0, "top_down": 1.0, "perturbed": 0.0}
        drawn = [plan("mixture", self.VIEW, seed, weights=weights)[0] for seed in range(400)]
        counts = [sum(grasp.proposer == name for grasp in drawn) for name in weights]
        assert counts[2] == 0
        assert sum(counts) == 400
        assert abs(counts[0] - 300) < 35  # four sigma

    def test_the_order_of_the_names_does_not_matter(self) -> None:
        one = {"uniform": 1.0, "top_down": 2.0}
        other = dict(reversed(one.items()))
        for seed in range(10):
            first = plan("mixture", self.VIEW, seed, weights=one)
            assert plain(first) == plain(plan("mixture", self.VIEW, seed, weights=other))

    def test_a_part_gets_its_settings(self) -> None:
        grasps = plan(
            "mixture",
            self.VIEW,
            weights={"perturbed": 1},
            parameters={"perturbed": {"base": "uniform", "base_parameters": {"aim_noise": 0.0}}},
        )
        assert {grasp.proposer for grasp in grasps} == {"uniform"}

    def test_by_default_it_mixes_all_that_look_for_themselves(self) -> None:
        proposers = {plan("mixture", self.VIEW, seed)[0].proposer for seed in range(30)}
        assert proposers == set(DIRECT)

    def test_the_recipe_holds_the_parts_settings_too(self) -> None:
        recipe = to_plain(POLICIES["mixture"].settings({"weights": {"top_down": 1}}))
        assert recipe["parameters"] == {"top_down": to_plain(TopDownParameters())}
        assert to_plain(POLICIES["mixture"].settings(recipe)) == recipe

    @pytest.mark.parametrize(
        ("plain_settings", "text"),
        [
            (
                {"weights": {"mixture": 1}},
                f"weights: got 'mixture', valid: {', '.join(DIRECT)}, perturbed",
            ),
            ({"weights": {}}, "weights: got {}, valid: names with weights >= 0"),
            ({"weights": {"uniform": 0}}, "weights: got {'uniform': 0.0}, valid: names"),
            (
                {"weights": {"uniform": 1}, "parameters": {"top_down": {}}},
                "parameters: got 'top_down', valid: uniform",
            ),
            (
                {"weights": {"uniform": 1}, "parameters": {"uniform": {"aim_noise": 9}}},
                "parameters.uniform: aim_noise: got 9.0, valid: 0.0 to 0.5 m",
            ),
        ],
    )
    def test_wrong_settings_are_named(self, plain_settings: dict[str, Any], text: str) -> None:
        with pytest.raises(ConfigError) as caught:
            POLICIES["mixture"].settings(plain_settings)
        assert str(caught.value).startswith(f"policy_parameters.mixture.{text}")


@dataclass(frozen=True)
class NoSettings:
    pass


@pytest.mark.parametrize(
    ("plan", "said"),
    [
        (lambda *_: 1 / 0, "policy own raises ZeroDivisionError: division by zero"),
        (lambda *_: sys.exit(3), "policy own raises SystemExit: 3"),
        (lambda *_: [], "policy own returns list, valid: a GraspPlan"),
        (
            lambda *_: GraspPlan(grasps=(Grasp(T_world_tcp=np.eye(3), width=0.05),)),
            "policy own: T_world_tcp of grasp 0 has shape (3, 3), valid: a finite pose (4, 4)",
        ),
        (
            lambda *_: GraspPlan(grasps=(Grasp(T_world_tcp=np.full((4, 4), np.nan), width=0.05),)),
            "policy own: T_world_tcp of grasp 0 has NaN or infinity, valid: a finite pose (4, 4)",
        ),
    ],
)
def test_what_is_no_plan_is_told_with_the_policy(plan: Any, said: str) -> None:
    policy = Policy(name="own", description="of a test", parameters=NoSettings, plan=plan)
    view: Any = None
    with pytest.raises(PolicyError, match=f"^{re.escape(said)}$"):
        checked_plan(policy, view, np.random.default_rng(0), NoSettings())
