from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from grasp_factory.core.config.factory_config import FactoryConfig
from grasp_factory.core.config.label import LabelConfig
from grasp_factory.core.config.motion import (
    MAX_STRETCH,
    MAX_TRANSFER_S,
    PEAK_OVER_MEAN,
    SHORTEST_MOTION_S,
    MotionConfig,
)
from grasp_factory.core.config.scene import WorkspaceConfig
from grasp_factory.core.config.shake import ShakeConfig
from grasp_factory.core.episode import Grasp
from grasp_factory.core.geometry import Array, rotation_about, rotation_vector, transform
from grasp_factory.robots import ROBOTS, arm_chain
from grasp_factory.robots.trajectory import (
    GraspMotion,
    JointSegment,
    plan_motion,
    sample,
)

HZ = 240
RECORD_HZ = 120
DEFAULT = MotionConfig()
CONFIGS = {
    "default": DEFAULT,
    "fast": MotionConfig(speed_scale=1.0, approach_speed=0.8, lift_speed=1.0),
    "slow": MotionConfig(speed_scale=0.5, approach_speed=0.05, lift_speed=0.1),
    "short": MotionConfig(
        pregrasp_distance=0.02, lift_height=0.02, approach_speed=0.1, lift_speed=0.1
    ),
}
GRASPS = 40

WAYPOINTS = st.integers(2, 12).flatmap(
    lambda count: st.integers(0, 2**32 - 1).map(
        lambda seed: np.cumsum(np.random.default_rng(seed).normal(0.0, 0.1, (count, 3)), axis=0)
    )
)
SEGMENTS = st.builds(JointSegment, WAYPOINTS, st.floats(0.15, 2.5))


def workspace_grasps(count: int, max_tilt: float) -> list[Array]:
    """Return random grasp poses in the workspace, within ``max_tilt`` rad of straight down."""
    rng = np.random.default_rng(5)
    space = WorkspaceConfig()
    down = np.diag([1.0, -1.0, -1.0])
    grasps = []
    for _ in range(count):
        x, y = rng.uniform(space.lower[:2], space.upper[:2])
        axis = rotation_about((0.0, 0.0, 1.0), rng.uniform(0.0, 2.0 * np.pi))[0]
        R = rotation_about(axis, rng.uniform(0.0, max_tilt)) @ down
        R = R @ rotation_about((0.0, 0.0, 1.0), rng.uniform(-np.pi / 2, np.pi / 2))
        grasps.append(transform(R, (x, y, rng.uniform(0.02, 0.15))))
    return grasps


def plan(robot: str, T_world_tcp: Array, motion: MotionConfig = DEFAULT) -> GraspMotion | None:
    model = ROBOTS[robot]
    grasp = Grasp(T_world_tcp=T_world_tcp, width=0.05)
    found = plan_motion(arm_chain(model), np.array(model.home), [grasp], motion)
    return None if found is None else found[1]


@cache
def planned(robot: str, config: str = "default") -> list[tuple[Array, GraspMotion]]:
    """Return the reachable ones among upright and tilted grasps, with their motions."""
    poses = workspace_grasps(GRASPS, 0.0) + workspace_grasps(GRASPS // 2, 0.4)
    motions = [(T, plan(robot, T, CONFIGS[config])) for T in poses]
    return [(T, motion) for T, motion in motions if motion is not None]


class TestSample:
    @given(SEGMENTS)
    def test_it_takes_whole_records_and_ends_at_the_last_waypoint(
        self, segment: JointSegment
    ) -> None:
        trajectory = sample(segment, HZ, RECORD_HZ)
        records, rest = divmod(len(trajectory.positions), HZ // RECORD_HZ)
        assert rest == 0
        assert segment.duration * RECORD_HZ <= records < segment.duration * RECORD_HZ + 1.0
        assert trajectory.velocities.shape == trajectory.positions.shape
        np.testing.assert_allclose(trajectory.positions[-1], segment.waypoints[-1], atol=1e-12)

    @given(SEGMENTS)
    def test_it_leaves_the_first_waypoint_from_rest(self, segment: JointSegment) -> None:
        # A minimum-jerk motion has done 10 tau^3 of its way; the path bends by some factor.
        trajectory = sample(segment, HZ, RECORD_HZ)
        steps = len(trajectory.positions)
        longest = np.abs(np.diff(segment.waypoints, axis=0)).max() * len(segment.waypoints)
        first = np.abs(trajectory.positions[0] - segment.waypoints[0]).max()
        assert first <= 10.0 / steps**3 * 4.0 * longest

    @given(SEGMENTS)
    def test_the_end_is_at_rest(self, segment: JointSegment) -> None:
        np.testing.assert_array_equal(sample(segment, HZ, RECORD_HZ).velocities[-1], 0.0)

    @given(SEGMENTS)
    def test_velocities_are_the_derivative_of_the_positions(self, segment: JointSegment) -> None:
        hz = 4000
        trajectory = sample(segment, hz, 1000)
        slope = (trajectory.positions[2:] - trajectory.positions[:-2]) * hz / 2.0
        fastest = np.abs(trajectory.velocities).max()
        np.testing.assert_allclose(slope, trajectory.velocities[1:-1], atol=0.01 * fastest)

    @given(WAYPOINTS)
    def test_the_path_passes_the_middle_waypoint_at_half_time(self, waypoints: Array) -> None:
        odd = np.vstack([waypoints, waypoints[::-1][1:]])
        trajectory = sample(JointSegment(odd, 1.0), 100, 50)
        np.testing.assert_allclose(trajectory.positions[49], waypoints[-1], atol=1e-12)

    def test_a_straight_way_follows_the_minimum_jerk_polynomial(self) -> None:
        segment = JointSegment(np.array([[0.0], [2.0]]), 0.5)
        trajectory = sample(segment, 100, 50)
        tau = np.arange(1, 51) / 50
        expected = 2.0 * (10 * tau**3 - 15 * tau**4 + 6 * tau**5)
        np.testing.assert_allclose(trajectory.positions[:, 0], expected, atol=1e-12)
        assert trajectory.velocities.max() == pytest.approx(PEAK_OVER_MEAN * 2.0 / 0.5)

    def test_standing_still_is_sampled_as_standing_still(self) -> None:
        trajectory = sample(JointSegment(np.ones((2, 7)), SHORTEST_MOTION_S), HZ, RECORD_HZ)
        np.testing.assert_array_equal(trajectory.positions, np.ones((36, 7)))
        np.testing.assert_array_equal(trajectory.velocities, np.zeros((36, 7)))


@pytest.mark.parametrize("robot", ROBOTS)
class TestPlan:
    def test_most_of_the_workspace_is_reachable(self, robot: str) -> None:
        assert len(planned(robot)) >= 0.9 * (GRASPS + GRASPS // 2)

    def test_the_three_motions_join_home_pregrasp_grasp_and_lift(self, robot: str) -> None:
        chain = arm_chain(ROBOTS[robot])
        for T_world_tcp, motion in planned(robot):
            np.testing.assert_array_equal(motion.transfer.waypoints[0], ROBOTS[robot].home)
            np.testing.assert_array_equal(
                motion.transfer.waypoints[-1], motion.approach.waypoints[0]
            )
            np.testing.assert_array_equal(motion.approach.waypoints[-1], motion.lift.waypoints[0])
            pregrasp, lifted = T_world_tcp.copy(), T_world_tcp.copy()
            pregrasp[:3, 3] -= 0.10 * T_world_tcp[:3, 2]
            lifted[2, 3] += 0.20
            ends = np.stack([motion.approach.waypoints[0], motion.lift.waypoints[0],
                             motion.lift.waypoints[-1]])  # fmt: skip
            expected = np.stack([pregrasp, T_world_tcp, lifted])
            np.testing.assert_allclose(chain.fk(ends), expected, atol=1e-5)

    def test_straight_motions_stay_on_their_line_without_turning(self, robot: str) -> None:
        chain = arm_chain(ROBOTS[robot])
        for T_world_tcp, motion in planned(robot):
            for segment, direction in (
                (motion.approach, T_world_tcp[:3, 2]),
                (motion.lift, np.array([0.0, 0.0, 1.0])),
            ):
                T_path = chain.fk(sample(segment, HZ, RECORD_HZ).positions)
                way = T_path[:, :3, 3] - T_world_tcp[:3, 3]
                off = way - (way @ direction)[:, None] * direction
                assert np.linalg.norm(off, axis=1).max() < 1e-4
                turns = [rotation_vector(T_world_tcp[:3, :3].T @ T[:3, :3]) for T in T_path[::4]]
                assert np.linalg.norm(turns, axis=1).max() < 1e-3

    def test_straight_motions_keep_to_their_speed_and_never_turn_back(self, robot: str) -> None:
        chain = arm_chain(ROBOTS[robot])
        for T_world_tcp, motion in planned(robot):
            for segment, direction, speed in (
                (motion.approach, T_world_tcp[:3, 2], DEFAULT.approach_speed),
                (motion.lift, np.array([0.0, 0.0, 1.0]), DEFAULT.lift_speed),
            ):
                along = chain.fk(sample(segment, HZ, RECORD_HZ).positions)[:, :3, 3] @ direction
                forward = np.diff(along) * HZ
                assert forward.min() > -1e-6
                assert forward.max() < 1.02 * speed

    @pytest.mark.slow
    @pytest.mark.parametrize("config", CONFIGS)
    def test_no_joint_exceeds_its_share_of_the_datasheets_speed(
        self, robot: str, config: str
    ) -> None:
        limits = arm_chain(ROBOTS[robot]).velocity_limits
        scale = CONFIGS[config].speed_scale
        for _, motion in planned(robot, config):
            for segment in (motion.transfer, motion.approach, motion.lift):
                share = np.abs(sample(segment, HZ, RECORD_HZ).velocities) / limits
                assert share.max() <= scale

    @pytest.mark.parametrize("config", CONFIGS)
    def test_no_joint_leaves_its_limits(self, robot: str, config: str) -> None:
        chain = arm_chain(ROBOTS[robot])
        for _, motion in planned(robot, config):
            for segment in (motion.transfer, motion.approach, motion.lift):
                positions = sample(segment, HZ, RECORD_HZ).positions
                assert (positions >= chain.lower - 1e-5).all()
                assert (positions <= chain.upper + 1e-5).all()

    @pytest.mark.parametrize("config", CONFIGS)
    def test_the_attempts_longest_time_bounds_every_motion(self, robot: str, config: str) -> None:
        settings = CONFIGS[config]
        assert planned(robot, config)
        for _, motion in planned(robot, config):
            assert SHORTEST_MOTION_S <= motion.transfer.duration <= MAX_TRANSFER_S
            for segment, nominal in (
                (motion.approach, settings.approach_s),
                (motion.lift, settings.lift_s),
            ):
                assert 1.0 <= segment.duration / nominal <= MAX_STRETCH
            for record_hz in (10, RECORD_HZ):
                whole = FactoryConfig(motion=settings, shake=ShakeConfig(levels=()),
                                      label=LabelConfig(min_lift=0.01, min_shake=0.0),
                                      record_hz=record_hz)  # fmt: skip
                seconds = settings.longest_close_s + settings.hold_s
                for segment in (motion.transfer, motion.approach, motion.lift):
                    seconds += len(sample(segment, HZ, RECORD_HZ).positions) / HZ
                assert seconds * record_hz <= whole.longest_attempt

    def test_planning_is_pure(self, robot: str) -> None:
        T_world_tcp = workspace_grasps(1, 0.0)[0]
        T_world_tcp.flags.writeable = False
        first, second = plan(robot, T_world_tcp), plan(robot, T_world_tcp)
        assert first is not None and second is not None
        for name in ("transfer", "approach", "lift"):
            a, b = getattr(first, name), getattr(second, name)
            np.testing.assert_array_equal(a.waypoints, b.waypoints)
            assert a.duration == b.duration

    @pytest.mark.parametrize(
        "position", [(2.0, 0.0, 0.1), (0.0, 0.0, 0.1), (0.5, 0.0, -0.9), (0.9, 0.9, 0.1)]
    )
    def test_what_is_out_of_reach_gives_none(
        self, robot: str, position: tuple[float, float, float]
    ) -> None:
        assert plan(robot, transform(np.diag([1.0, -1.0, -1.0]), position)) is None

    def test_a_reachable_grasp_whose_lift_is_out_of_reach_gives_none(self, robot: str) -> None:
        T_world_tcp = transform(np.diag([1.0, -1.0, -1.0]), (0.62, 0.0, 0.45))
        high = MotionConfig(lift_height=0.5)
        assert plan(robot, T_world_tcp, MotionConfig(lift_height=0.02)) is not None
        assert plan(robot, T_world_tcp, high) is None

    def test_an_arm_that_may_only_creep_reaches_nothing_in_time(self, robot: str) -> None:
        assert plan(robot, workspace_grasps(1, 0.0)[0], MotionConfig(speed_scale=0.05)) is None
