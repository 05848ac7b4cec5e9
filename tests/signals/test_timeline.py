from __future__ import annotations

import itertools

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from grasp_factory.core.geometry import Pose, quat_xyzw_to_matrix, rotation_about, rotation_vector
from grasp_factory.errors import UsageError
from grasp_factory.signals import approximate_time, interpolate_poses, linear, nearest, slerp

TIMES = st.lists(st.integers(0, 40), min_size=1, max_size=7, unique=True).map(sorted)
SERIES = st.lists(TIMES, min_size=1, max_size=4)
SEEDS = st.integers(0, 2**32 - 1)


def sets_of(
    *series: list[float], slop: float = float("inf"), age_penalty: float = 0.0
) -> list[tuple[float, ...]]:
    """Return the sets as the times of their members; series are named 0, 1, ..."""
    named = {str(i): times for i, times in enumerate(series)}
    found = approximate_time(named, slop, age_penalty)
    columns = [np.array(named[name])[index].tolist() for name, index in found.indices.items()]
    return list(zip(*columns, strict=True))


def span(times: tuple[float, ...]) -> float:
    return max(times) - min(times)


class TestApproximateTime:
    # Timestamps and sets of message_filters/test/test_approximate_time_policy.cpp (ros_comm),
    # with the set at the end that a live node is still waiting to form.
    @pytest.mark.parametrize("age_penalty", [0.0, 0.1])
    @pytest.mark.parametrize(
        ("series", "expected"),
        [
            ([[0, 3, 6], [0, 3, 6]], [(0, 0), (3, 3), (6, 6)]),
            ([[0, 3, 6], [1, 4, 7]], [(0, 1), (3, 4), (6, 7)]),
            ([[0, 2, 3, 6], [1, 5, 7]], [(0, 1), (6, 5)]),
            ([[0, 12, 17], [7, 15, 18]], [(12, 7), (17, 18)]),
            ([[0, 4, 8, 10, 13], [1, 3, 7, 11, 14]], [(0, 1), (4, 3), (8, 7), (10, 11), (13, 14)]),
            ([[0, 3], [1, 3]], [(0, 1), (3, 3)]),
            (
                [[0, 5, 8, 10, 13], [1, 6, 9, 14], [2, 6, 10], [3, 5, 11]],
                [(0, 1, 2, 3), (5, 6, 6, 5), (10, 9, 10, 11)],
            ),
            ([[0, 7], [1], [2], [3]], [(0, 1, 2, 3)]),
        ],
        ids=["exact", "perfect", "imperfect", "acceleration", "dropped", "double", "four", "early"],
    )
    def test_the_policys_own_cases(
        self, series: list[list[float]], expected: list[tuple[float, ...]], age_penalty: float
    ) -> None:
        assert sets_of(*series, age_penalty=age_penalty) == expected

    def test_a_slow_series_takes_the_nearest_of_a_fast_one(self) -> None:
        fast, slow = list(np.arange(0, 20) / 10), [0.32, 1.08]
        assert sets_of(fast, slow) == [(pytest.approx(0.3), 0.32), (pytest.approx(1.1), 1.08)]

    def test_an_age_penalty_takes_the_earlier_of_two_that_are_nearly_equal(self) -> None:
        assert sets_of([0, 2], [1.04]) == [(2, 1.04)]
        assert sets_of([0, 2], [1.04], age_penalty=0.1) == [(0, 1.04)]

    def test_of_equal_sets_the_earlier_one_is_taken(self) -> None:
        assert sets_of([0, 2], [1]) == [(0, 1)]

    def test_a_set_wider_than_the_slop_is_not_formed(self) -> None:
        assert sets_of([0, 1.0], [0.3, 1.1], slop=0.2) == [(1.0, 1.1)]
        assert sets_of([0, 1.0], [0.3, 1.1], slop=0.3) == [(0, 0.3), (1.0, 1.1)]

    def test_a_span_of_exactly_the_slop_is_a_match_whatever_the_floats_say(self) -> None:
        assert 1.1 - 1.0 > 0.1  # in float64
        assert sets_of([0.2, 1.0], [0.3, 1.1], slop=0.1) == [(0.2, 0.3), (1.0, 1.1)]

    def test_what_is_in_no_set_is_told_per_series(self) -> None:
        found = approximate_time({"a": [0, 2, 3, 6], "b": [1, 5, 7]})
        np.testing.assert_array_equal(found.indices["a"], [0, 3])
        np.testing.assert_array_equal(found.indices["b"], [0, 1])
        np.testing.assert_array_equal(found.unmatched["a"], [1, 2])
        np.testing.assert_array_equal(found.unmatched["b"], [2])

    def test_with_an_empty_series_nothing_matches(self) -> None:
        found = approximate_time({"a": [0.0, 1.0], "b": []})
        assert len(found.indices["a"]) == len(found.indices["b"]) == 0
        np.testing.assert_array_equal(found.unmatched["a"], [0, 1])

    @given(SERIES, st.sampled_from([float("inf"), 0.0, 2.0, 5.0]), st.sampled_from([0.0, 0.1]))
    def test_the_rules_hold(
        self, series: list[list[float]], slop: float, age_penalty: float
    ) -> None:
        named = {str(i): times for i, times in enumerate(series)}
        found = approximate_time(named, slop, age_penalty)
        for name, times in named.items():
            used, unused = found.indices[name], found.unmatched[name]
            assert (np.diff(used) > 0).all()  # used once, and sets do not cross
            assert sorted([*used, *unused]) == list(range(len(times)))
        sets = sets_of(*series, slop=slop, age_penalty=age_penalty)
        assert all(span(s) <= slop for s in sets)
        if slop == float("inf"):
            assert sets  # nothing is too far apart to match
            steps = np.diff([found.indices[name] for name in named], axis=1)
            assert (steps == 1).any(axis=0).all()  # contiguous: no room for another set between

    @given(SERIES)
    def test_every_set_is_the_smallest_that_starts_no_later_than_its_pivot(
        self, series: list[list[float]]
    ) -> None:
        line = [list(times) for times in series]
        for found in sets_of(*series):
            pivot = max(times[0] for times in line)
            choices = [s for s in itertools.product(*line) if min(s) <= pivot]
            assert span(found) == min(span(s) for s in choices)
            line = [[t for t in times if t > last] for times, last in zip(line, found, strict=True)]
        assert not all(line)  # it stops where a series has ended

    @given(SERIES)
    def test_moving_all_clocks_together_changes_nothing(self, series: list[list[float]]) -> None:
        moved = [[t + 0.3 for t in times] for times in series]
        a, b = (approximate_time({str(i): t for i, t in enumerate(s)}) for s in (series, moved))
        for name in a.indices:
            np.testing.assert_array_equal(a.indices[name], b.indices[name])

    def test_no_series_at_all_is_refused(self) -> None:
        with pytest.raises(UsageError, match="no series given"):
            approximate_time({})

    def test_times_that_go_back_are_refused_by_name(self) -> None:
        with pytest.raises(UsageError, match=r"imu: sample 2 at 1\.0 s follows one at 2\.0 s"):
            approximate_time({"tactile": [0.0], "imu": [0.0, 2.0, 1.0]})

    @pytest.mark.parametrize("slop", [-0.1, float("nan")])
    def test_a_slop_that_is_none_is_refused(self, slop: float) -> None:
        with pytest.raises(UsageError, match=r"slop .*: valid: 0 s or more"):
            approximate_time({"a": [0.0]}, slop)


class TestNearest:
    def test_each_instant_gets_the_sample_next_to_it(self) -> None:
        out = nearest([0.0, 1.0, 2.0], [10, 11, 12], [1.9, -0.1, 0.4, 2.1, 1.0], slop=0.4)
        np.testing.assert_array_equal(out.values, [12, 10, 10, 12, 11])
        assert out.matched.all()

    def test_what_is_farther_than_the_slop_is_not_matched(self) -> None:
        out = nearest([0.0, 1.0], [[1.0, 2.0], [3.0, 4.0]], [0.1, 0.11, 5.0], slop=0.1)
        np.testing.assert_array_equal(out.matched, [True, False, False])
        np.testing.assert_array_equal(out.values, [[1.0, 2.0], [np.nan] * 2, [np.nan] * 2])

    def test_codes_stay_whole_numbers(self) -> None:
        out = nearest([0.0], np.array([7], np.uint8), [0.0, 9.0], slop=1.0)
        assert out.values.dtype == np.uint8
        np.testing.assert_array_equal(out.values, [7, 0])

    def test_of_two_equally_near_the_earlier_is_taken(self) -> None:
        assert nearest([0.1, 0.3], [1, 2], [0.2], slop=1.0).values[0] == 1

    @given(TIMES, st.lists(st.integers(-5, 45), max_size=6), st.integers(0, 10))
    def test_it_is_the_search_through_all_samples(
        self, times: list[int], at: list[int], slop: int
    ) -> None:
        out = nearest(times, times, at, slop)
        for value, matched, t in zip(out.values, out.matched, at, strict=True):
            best = min(times, key=lambda s: (abs(s - t), s))
            assert matched == (abs(best - t) <= slop)
            assert value == (best if matched else 0)

    def test_padding_is_refused(self) -> None:
        with pytest.raises(UsageError, match="times: not finite"):
            nearest([0.0, np.nan], [1, 2], [0.0], slop=1.0)


class TestLinear:
    def test_between_two_samples_it_is_on_the_line(self) -> None:
        out = linear([0.0, 2.0, 3.0], [[0.0, 1.0], [4.0, 1.0], [0.0, 5.0]], [0.5, 2.75])
        np.testing.assert_allclose(out.values, [[1.0, 1.0], [1.0, 4.0]])

    def test_it_never_extrapolates(self) -> None:
        out = linear([1.0, 2.0], [5.0, 6.0], [0.999, 1.0, 2.0, 2.001])
        np.testing.assert_array_equal(out.matched, [False, True, True, False])
        np.testing.assert_array_equal(out.values, [np.nan, 5.0, 6.0, np.nan])

    @given(TIMES, SEEDS)
    def test_on_its_samples_a_series_is_itself(self, times: list[int], seed: int) -> None:
        values = np.random.default_rng(seed).normal(size=(len(times), 2, 3))
        out = linear(times, values, times)
        assert out.matched.all()
        np.testing.assert_array_equal(out.values, values)

    @given(TIMES, st.lists(st.floats(-5.0, 45.0), max_size=6), SEEDS)
    def test_it_is_numpys_interpolation_inside(
        self, times: list[int], at: list[float], seed: int
    ) -> None:
        values = np.random.default_rng(seed).normal(size=len(times))
        out = linear(times, values, at)
        expected = np.interp(np.round(at, 9), times, values)
        np.testing.assert_allclose(out.values[out.matched], expected[out.matched], atol=1e-8)

    def test_a_single_sample_matches_its_own_instant_only(self) -> None:
        np.testing.assert_array_equal(linear([1.0], [3.0], [1.0, 1.1]).matched, [True, False])

    @pytest.mark.parametrize("align", [linear, lambda t, v, at: nearest(t, v, at, 9.0)])
    def test_an_empty_series_matches_nothing(self, align) -> None:
        out = align([], np.zeros((0, 3)), [0.0, 1.0])
        assert out.values.shape == (2, 3)
        assert not out.matched.any()


class TestSlerp:
    @given(SEEDS, st.floats(0.0, 3.1), st.floats(0.0, 1.0), st.sampled_from([1.0, -1.0]))
    def test_it_turns_evenly_about_a_fixed_axis_the_short_way(
        self, seed: int, angle: float, part: float, sign: float
    ) -> None:
        rng = np.random.default_rng(seed)
        axis = rng.normal(size=3)
        axis /= np.linalg.norm(axis)
        start = quat_xyzw_to_matrix(rng.normal(size=4))
        ends = [start, rotation_about(axis, angle) @ start]
        quats = np.array([Pose.from_matrix(_pose(R)).quat_xyzw for R in ends])
        quats[1] *= 2.0 * sign  # neither the sign nor the length says anything
        out = slerp([0.0, 4.0], quats, [4.0 * part])
        assert np.linalg.norm(out.values[0]) == pytest.approx(1.0)
        turned = rotation_vector(quat_xyzw_to_matrix(out.values[0]) @ start.T)
        np.testing.assert_allclose(turned, part * angle * axis, atol=1e-7)

    def test_it_never_extrapolates(self) -> None:
        quats = [[0.0, 0.0, 0.0, 1.0], [0.0, 0.0, 1.0, 0.0]]
        out = slerp([0.0, 1.0], quats, [-0.5, 0.0, 1.0, 1.5])
        np.testing.assert_array_equal(out.matched, [False, True, True, False])
        assert np.isnan(out.values[[0, 3]]).all()

    @given(SEEDS, st.lists(st.floats(-0.5, 5.5), max_size=5))
    def test_poses_go_along_lines_and_turn_evenly(self, seed: int, at: list[float]) -> None:
        poses = np.random.default_rng(seed).normal(size=(6, 2, 7))
        times = np.arange(6.0)
        out = interpolate_poses(times, poses, at)
        position, rotation = linear(times, poses[..., :3], at), slerp(times, poses[..., 3:], at)
        np.testing.assert_array_equal(out.values[..., :3], position.values)
        np.testing.assert_array_equal(out.values[..., 3:], rotation.values)
        np.testing.assert_array_equal(out.matched, position.matched)


def _pose(R: np.ndarray) -> np.ndarray:
    T = np.eye(4)
    T[:3, :3] = R
    return T
