from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pybullet_data
import pytest
from support.scale import scaled

from grasp_factory.core.geometry import rotation_about, rotation_vector, transform
from grasp_factory.robots import ik
from grasp_factory.robots.ik import (
    MAX_JOINT_STEP,
    SAME_SOLUTION,
    ik_solutions,
    solve_ik,
    track_path,
)
from grasp_factory.robots.kinematics import Chain

DATA = Path(pybullet_data.getDataPath())
IIWA = Chain.from_urdf(
    DATA / "kuka_iiwa/model.urdf", "lbr_iiwa_link_0", "lbr_iiwa_link_7"
).with_tool(transform(np.eye(3), [0.0, 0.0, 0.195]))
PANDA = Chain.from_urdf(DATA / "franka_panda/panda.urdf", "panda_link0", "panda_grasptarget")
HOME = {
    "iiwa": np.array([0.0, 0.4, 0.0, -1.4, 0.0, 1.3, 0.0]),
    "panda": np.array([0.0, -0.785, 0.0, -2.356, 0.0, 1.571, 0.785]),
}
ARMS = {"iiwa": IIWA, "panda": PANDA}
BENDS = [1, 3, 5]
"""Shoulder, elbow and wrist bend: an arm is singular where one of them is straight."""


def random_postures(chain: Chain, count: int) -> np.ndarray:
    rng = np.random.default_rng(1)
    return rng.uniform(chain.lower, chain.upper, (count, len(chain.lower)))


def cornered_postures(chain: Chain, count: int) -> np.ndarray:
    """Return postures with every joint exactly at a limit."""
    is_low = np.random.default_rng(2).random((count, len(chain.lower))) < 0.5
    return np.where(is_low, chain.lower, chain.upper)


def half_cornered_postures(chain: Chain, count: int) -> np.ndarray:
    is_free = np.random.default_rng(3).random((count, len(chain.lower))) < 0.5
    return np.where(is_free, random_postures(chain, count), cornered_postures(chain, count))


def elbow_straight_postures(chain: Chain, count: int) -> np.ndarray:
    q = random_postures(chain, count)
    q[:, 3] = np.clip(0.0, chain.lower[3], chain.upper[3])
    return q


def singular_postures(chain: Chain, count: int) -> np.ndarray:
    """Return postures with shoulder, elbow and wrist almost straight."""
    q = random_postures(chain, count)
    bends = np.random.default_rng(4).normal(0.0, 0.01, (count, 3))
    q[:, BENDS] = np.clip(bends, chain.lower[BENDS], chain.upper[BENDS])
    return q


def top_down(x: float, y: float, z: float, yaw: float) -> np.ndarray:
    """Return a tip pose that looks straight down."""
    return transform(rotation_about([0, 0, 1], yaw) @ np.diag([1.0, -1.0, -1.0]), [x, y, z])


def descent(count: int) -> np.ndarray:
    T_path = np.repeat(top_down(0.55, 0.1, 0.05, 0.3)[None], count, axis=0)
    T_path[:, 2, 3] += np.linspace(0.12, 0.0, count)
    return T_path


def pose_distance(T_a: np.ndarray, T_b: np.ndarray) -> tuple[float, float]:
    """Return the metres and radians between two poses, by code that the solver does not use."""
    turn = rotation_vector(T_a[:3, :3] @ T_b[:3, :3].T)
    return float(np.linalg.norm(T_a[:3, 3] - T_b[:3, 3])), float(np.linalg.norm(turn))


def assert_solves(chain: Chain, q: np.ndarray, T_base_tip: np.ndarray) -> None:
    metres, radians = pose_distance(chain.fk(q), T_base_tip)
    assert metres < 1.1e-6
    assert radians < 1.1e-6
    assert np.all((chain.lower <= q) & (q <= chain.upper))


@pytest.mark.slow
@pytest.mark.parametrize("arm", ARMS)
@pytest.mark.parametrize(
    "postures",
    [
        random_postures,
        cornered_postures,
        half_cornered_postures,
        elbow_straight_postures,
        singular_postures,
    ],
)
def test_ik_reaches_every_pose_that_forward_kinematics_made(arm: str, postures) -> None:
    chain = ARMS[arm]
    for T_base_tip in chain.fk(postures(chain, scaled(80, 200))):
        result = solve_ik(chain, T_base_tip, HOME[arm])
        assert result.success
        assert_solves(chain, result.joint_positions, T_base_tip)


@pytest.mark.parametrize("arm", ARMS)
def test_ik_reaches_the_table_from_above_whichever_way_the_hand_is_turned(arm: str) -> None:
    for x in (0.45, 0.55, 0.65):
        for y in (-0.2, 0.0, 0.2):
            for yaw in np.linspace(-np.pi, np.pi, 9):
                T_base_tip = top_down(x, y, 0.1, yaw)
                result = solve_ik(ARMS[arm], T_base_tip, HOME[arm])
                assert_solves(ARMS[arm], result.joint_positions, T_base_tip)


@pytest.mark.soak
@pytest.mark.slow
def test_the_iiwa_misses_from_above_only_what_its_elbow_cannot_reach() -> None:
    shoulder = np.array([0.0, 0.0, 0.36])
    upper_arm, forearm, wrist_to_tip = 0.42, 0.40, 0.081 + 0.195  # model.urdf and the tool
    straightest, most_bent = 0.0, IIWA.upper[3]
    farthest, nearest = (
        np.sqrt(upper_arm**2 + forearm**2 + 2 * upper_arm * forearm * np.cos(angle))
        for angle in (straightest, most_bent)
    )
    outcomes = set()
    for x in np.arange(0.32, 0.85, 0.06):
        for y in (-0.3, -0.1, 0.0, 0.2):
            for yaw in (-2.0, 0.5):
                wrist = np.array([x, y, 0.1 + wrist_to_tip])
                is_possible = nearest < np.linalg.norm(wrist - shoulder) < farthest
                result = solve_ik(IIWA, top_down(x, y, 0.1, yaw), HOME["iiwa"])
                assert result.success == is_possible
                outcomes.add(result.success)
    assert outcomes == {True, False}


@pytest.mark.parametrize("arm", ARMS)
def test_where_the_search_starts_does_not_decide_whether_it_succeeds(arm: str) -> None:
    chain = ARMS[arm]
    starts = [chain.lower, chain.upper, np.zeros(7), *random_postures(chain, 30)]
    for T_base_tip in chain.fk(half_cornered_postures(chain, 4)):
        for start in starts:
            assert_solves(chain, solve_ik(chain, T_base_tip, start).joint_positions, T_base_tip)


def test_half_a_turn_from_the_start_is_solved() -> None:
    T_home = IIWA.fk(HOME["iiwa"])
    T_base_tip = T_home @ np.diag([-1.0, -1.0, 1.0, 1.0])
    assert_solves(IIWA, solve_ik(IIWA, T_base_tip, HOME["iiwa"]).joint_positions, T_base_tip)


def test_a_missing_half_turn_is_reported_as_half_a_turn() -> None:
    turntable = Chain(
        joint_names=("yaw",),
        lower=np.array([-0.1]),
        upper=np.array([0.1]),
        velocity_limits=np.array([1.0]),
        T_previous_joint=np.eye(4)[None],
        T_joint_tip=np.eye(4),
    )
    result = solve_ik(turntable, np.diag([1.0, -1.0, -1.0, 1.0]), np.zeros(1))
    assert not result.success
    assert result.position_error == 0.0
    assert result.orientation_error == pytest.approx(np.pi)


def test_a_start_that_solves_the_pose_is_returned_as_it_is() -> None:
    result = solve_ik(IIWA, IIWA.fk(HOME["iiwa"]), HOME["iiwa"])
    np.testing.assert_array_equal(result.joint_positions, HOME["iiwa"])


def test_a_small_motion_of_the_tip_is_a_small_motion_of_the_arm() -> None:
    T_base_tip = IIWA.fk(HOME["iiwa"])
    T_base_tip[:3, 3] += [0.005, -0.005, 0.005]
    result = solve_ik(IIWA, T_base_tip, HOME["iiwa"])
    assert result.success
    assert np.abs(result.joint_positions - HOME["iiwa"]).max() < 0.05


def test_a_start_outside_the_limits_gives_a_posture_within_them() -> None:
    T_base_tip = IIWA.fk(HOME["iiwa"])
    turn = 2 * np.pi * np.eye(7)[0]  # the same pose, but joint 1 cannot get there
    for start in (HOME["iiwa"] + turn, np.full(7, 9.0)):
        assert_solves(IIWA, solve_ik(IIWA, T_base_tip, start).joint_positions, T_base_tip)


@pytest.mark.parametrize(
    "T_base_tip",
    [
        top_down(2.0, 0.0, 0.3, 0.0),  # far away
        top_down(0.95, 0.0, 0.3, 0.4),  # within the sum of the links, out of reach looking down
        top_down(0.03, 0.0, 0.35, 0.0),  # inside the arm's own pedestal
    ],
)
def test_an_unreachable_pose_is_no_success_and_its_errors_are_true(T_base_tip: np.ndarray) -> None:
    for arm, chain in ARMS.items():
        result = solve_ik(chain, T_base_tip, HOME[arm])
        assert not result.success
        q = result.joint_positions
        assert np.all((chain.lower <= q) & (q <= chain.upper))
        metres, radians = pose_distance(chain.fk(q), T_base_tip)
        assert result.position_error == pytest.approx(metres, abs=1e-9)
        assert result.orientation_error == pytest.approx(radians, abs=1e-7)
        assert metres + radians > 0.01
        assert ik_solutions(chain, T_base_tip, HOME[arm]).shape == (0, 7)


@pytest.mark.slow
@pytest.mark.parametrize("T_base_tip", [top_down(0.95, 0.0, 0.3, 0.4), top_down(0.1, 0, -0.3, 1)])
@pytest.mark.parametrize("arm", ARMS)
def test_the_closest_posture_to_an_unreachable_pose_does_not_depend_on_the_start(
    arm: str, T_base_tip: np.ndarray
) -> None:
    chain = ARMS[arm]
    misses = []
    for start in [HOME[arm], chain.lower, *random_postures(chain, 3)]:
        result = solve_ik(chain, T_base_tip, start)
        misses.append(np.hypot(result.position_error, result.orientation_error))
    assert max(misses) < 1.001 * min(misses)


def test_a_pose_farther_than_all_links_is_not_searched_for(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def search(*_: object) -> np.ndarray:
        pytest.fail("restarts for a pose that no posture can reach")

    monkeypatch.setattr(ik, "_spread", search)
    assert not solve_ik(IIWA, top_down(2.0, 0.0, 0.3, 0.0), HOME["iiwa"]).success


def test_the_reported_errors_of_a_success_are_those_of_its_posture() -> None:
    for T_base_tip in IIWA.fk(random_postures(IIWA, 20)):
        result = solve_ik(IIWA, T_base_tip, HOME["iiwa"])
        metres, radians = pose_distance(IIWA.fk(result.joint_positions), T_base_tip)
        assert result.position_error == pytest.approx(metres, abs=1e-9)
        assert result.orientation_error == pytest.approx(radians, abs=1e-9)


def test_a_pose_that_is_not_a_number_is_no_success() -> None:
    assert not solve_ik(IIWA, np.full((4, 4), np.nan), HOME["iiwa"]).success


def test_the_same_question_has_the_same_bits_as_answer_whatever_was_asked_before() -> None:
    poses = IIWA.fk(cornered_postures(IIWA, 10))
    first = [solve_ik(IIWA, T, HOME["iiwa"]).joint_positions.tobytes() for T in poses]
    np.random.seed(123)  # a global generator in use would show
    solve_ik(PANDA, PANDA.fk(HOME["panda"]), np.zeros(7))
    again = [solve_ik(IIWA, T, HOME["iiwa"]).joint_positions.tobytes() for T in poses[::-1]]
    assert again[::-1] == first
    twice = [ik_solutions(IIWA, poses[0], HOME["iiwa"]).tobytes() for _ in range(2)]
    assert twice[0] == twice[1]


def test_the_arguments_are_left_as_they_were() -> None:
    T_path, start = descent(5), np.full(7, 9.0)
    for solve in (solve_ik, ik_solutions):
        solve(IIWA, T_path[0], start)
    track_path(IIWA, T_path, start)
    np.testing.assert_array_equal(T_path, descent(5))
    np.testing.assert_array_equal(start, np.full(7, 9.0))


@pytest.mark.parametrize("arm", ARMS)
def test_solutions_are_distinct_and_the_soonest_reached_come_first(arm: str) -> None:
    chain = dataclasses.replace(ARMS[arm], velocity_limits=np.array([1, 2, 1, 2, 1, 2, 4.0]))
    T_base_tip = top_down(0.5, 0.1, 0.2, 0.5)
    solutions = ik_solutions(chain, T_base_tip, HOME[arm])
    assert len(solutions) > 10
    for q in solutions:
        assert_solves(chain, q, T_base_tip)
    times = np.max(np.abs(solutions - HOME[arm]) / chain.velocity_limits, axis=1)
    assert np.all(np.diff(times) >= 0.0)
    apart = np.abs(solutions[:, None] - solutions[None]).max(axis=-1)
    assert apart[~np.eye(len(solutions), dtype=bool)].min() > SAME_SOLUTION


def test_solutions_include_elbow_and_wrist_bent_both_ways() -> None:
    solutions = ik_solutions(IIWA, top_down(0.5, 0.1, 0.2, 0.5), HOME["iiwa"])
    for joint in (3, 5):
        assert set(np.sign(solutions[:, joint])) == {-1.0, 1.0}


@pytest.mark.parametrize("arm", ARMS)
def test_a_path_is_followed_without_jumps(arm: str) -> None:
    chain, T_path = ARMS[arm], descent(20)
    start = solve_ik(chain, T_path[0], HOME[arm]).joint_positions
    path = track_path(chain, T_path, start)
    assert path.success
    assert path.failed_waypoint is None
    for q, T_base_tip in zip(path.joint_positions, T_path, strict=True):
        assert_solves(chain, q, T_base_tip)
    assert np.abs(np.diff(path.joint_positions, axis=0, prepend=start[None])).max() < 0.06
    halfway = chain.fk((path.joint_positions[1:] + path.joint_positions[:-1]) / 2)[:, :3, 3]
    line = (T_path[1:, :3, 3] + T_path[:-1, :3, 3]) / 2
    assert np.linalg.norm(halfway - line, axis=1).max() < 1e-3


def test_a_path_that_leaves_the_reach_fails_at_the_waypoint_that_does() -> None:
    T_path = np.repeat(top_down(0.5, 0.0, 0.3, 0.0)[None], 60, axis=0)
    T_path[:, 0, 3] += np.linspace(0.0, 0.59, 60)
    start = solve_ik(IIWA, T_path[0], HOME["iiwa"]).joint_positions
    path = track_path(IIWA, T_path, start)
    assert not path.success
    assert path.failed_waypoint is not None
    assert path.joint_positions.shape == (path.failed_waypoint, 7)
    stretched = np.sqrt(0.82**2 - (0.3 + 0.276 - 0.36) ** 2)  # shoulder to wrist, see above
    assert stretched - 0.02 < T_path[path.failed_waypoint, 0, 3] < stretched + 0.01


def test_a_path_that_jumps_or_starts_elsewhere_fails_there() -> None:
    T_path = descent(20)
    start = solve_ik(IIWA, T_path[0], HOME["iiwa"]).joint_positions
    jump = T_path.copy()
    jump[7:, :3, :3] = jump[7:, :3, :3] @ rotation_about([0, 0, 1], -1.0)
    assert track_path(IIWA, jump, start).failed_waypoint == 7
    assert track_path(IIWA, jump, start, max_joint_step=2.0).success
    assert track_path(IIWA, T_path, start + 2 * MAX_JOINT_STEP).failed_waypoint == 0


def test_a_path_without_waypoints_is_followed() -> None:
    path = track_path(IIWA, np.empty((0, 4, 4)), HOME["iiwa"])
    assert path.success
    assert path.joint_positions.shape == (0, 7)
