from __future__ import annotations

import dataclasses
import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from grasp_factory.core.config.label import LabelConfig
from grasp_factory.core.enums import Label, Outcome, Phase
from grasp_factory.core.geometry import Array, Pose, rotation_about, transform
from grasp_factory.core.schema import MAX_CONTACTS
from grasp_factory.labels.rule import (
    FELL_OFF,
    Measurements,
    judge,
    measure,
    pad_normal_force,
    target_com,
    touching,
)

Streams = dict[str, NDArray[Any]]

HZ = 120
REST = 0.0625
LIMIT = LabelConfig(min_lift=0.125, min_shake=0.0)  # floats and float32 agree on these
UP = REST + LIMIT.min_lift
CENTERED = np.zeros(3)
JUST_BELOW = float(np.nextafter(np.float32(UP), np.float32(0.0)))
ATTEMPT = (Phase.PREGRASP,) * 2 + (Phase.APPROACH,) * 2 + (Phase.CLOSE,) * 3 + (Phase.LIFT,) * 4
HELD = ATTEMPT + (Phase.HOLD,) * 5
CLOSED, LIFTED = 6, 10
"""The last records of the closing and of the lift."""


def make_streams(phases: tuple[Phase, ...]) -> Streams:
    """Return an attempt in which nothing is touched and the target stays at rest."""
    n = len(phases)
    still = np.tile(np.array([0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0], np.float32), (n, 1))
    streams: Streams = {
        "timestamp": np.arange(1, n + 1) / HZ,
        "phase": np.array(phases, np.uint8),
        "tcp_pose": still.copy(),
        "object_pose": still[:, None].copy(),
        "tactile_body": np.zeros((n, 2, MAX_CONTACTS), np.uint8),
        "tactile_depth": np.full((n, 2, MAX_CONTACTS), np.nan, np.float32),
        "shake_level": np.zeros(n, np.float32),
    }
    for name in ("position", "force", "normal"):
        streams[f"tactile_{name}"] = np.full((n, 2, MAX_CONTACTS, 3), np.nan, np.float32)
    streams["object_pose"][:, 0, 2] = REST
    return streams


def press(
    streams: Streams,
    records: slice | int,
    pads: tuple[int, ...] = (0, 1),
    *,
    body: Label = Label.TARGET,
    slot: int = 0,
    force: tuple[float, float, float] = (0.0, 2.0, 0.0),
) -> None:
    """Let a body press on pads at some records, with a normal along +y."""
    for pad in pads:
        streams["tactile_body"][records, pad, slot] = body
        streams["tactile_position"][records, pad, slot] = 0.0
        streams["tactile_normal"][records, pad, slot] = (0.0, 1.0, 0.0)
        streams["tactile_force"][records, pad, slot] = force


def held_attempt() -> Streams:
    """Return an attempt in which the target is gripped, lifted and held."""
    streams = make_streams(HELD)
    press(streams, slice(CLOSED, None))
    streams["object_pose"][LIFTED:, 0, 2] = UP + 0.05
    return streams


def outcome(streams: Streams, com: Array = CENTERED) -> Outcome:
    return judge(streams, com, REST, LIMIT)


def put(streams: Streams, name: str, record: int, T: Array) -> None:
    pose = Pose.from_matrix(T)
    row = (*pose.position, *pose.quat_xyzw)
    target = streams[name][record]
    target[...] = np.reshape(row, target.shape)


class TestJudge:
    def test_a_target_held_by_both_pads_at_the_end_is_a_success(self) -> None:
        assert outcome(held_attempt()) is Outcome.SUCCESS

    def test_a_lift_of_exactly_the_threshold_is_enough(self) -> None:
        streams = held_attempt()
        streams["object_pose"][-1, 0, 2] = UP
        assert outcome(streams) is Outcome.SUCCESS

    def test_a_hair_below_the_threshold_is_not_enough(self) -> None:
        streams = held_attempt()
        streams["object_pose"][-1, 0, 2] = JUST_BELOW
        assert outcome(streams) is Outcome.LOST_IN_HOLD

    @pytest.mark.parametrize("pad", [0, 1])
    def test_one_pad_alone_does_not_hold(self, pad: int) -> None:
        streams = held_attempt()
        streams["tactile_body"][-1, pad] = Label.BACKGROUND
        assert outcome(streams) is Outcome.LOST_IN_HOLD

    def test_a_touch_lost_and_found_again_before_the_end_is_a_success(self) -> None:
        streams = held_attempt()
        streams["tactile_body"][-3:-1] = Label.BACKGROUND
        assert outcome(streams) is Outcome.SUCCESS

    def test_an_attempt_that_ends_with_the_lift_is_no_success(self) -> None:
        streams = make_streams(ATTEMPT)
        press(streams, slice(CLOSED, None))
        streams["object_pose"][LIFTED:, 0, 2] = UP
        assert outcome(streams) is not Outcome.SUCCESS

    def test_a_target_that_was_up_after_the_lift_is_lost_in_the_hold(self) -> None:
        streams = held_attempt()
        streams["object_pose"][LIFTED, 0, 2] = UP
        streams["object_pose"][LIFTED + 2 :, 0, 2] = REST
        streams["tactile_body"][LIFTED + 2 :] = Label.BACKGROUND
        assert outcome(streams) is Outcome.LOST_IN_HOLD

    def test_a_target_not_up_after_the_lift_is_lost_in_the_lift(self) -> None:
        streams = held_attempt()
        streams["object_pose"][LIFTED:, 0, 2] = JUST_BELOW
        assert outcome(streams) is Outcome.LOST_IN_LIFT

    def test_a_target_dropped_by_one_pad_after_the_lift_is_lost_in_the_lift(self) -> None:
        streams = held_attempt()
        streams["tactile_body"][LIFTED:, 1] = Label.BACKGROUND
        assert outcome(streams) is Outcome.LOST_IN_LIFT

    def test_a_touch_that_never_reached_the_lift_is_lost_in_the_lift(self) -> None:
        streams = make_streams(ATTEMPT)
        press(streams, CLOSED)
        assert outcome(streams) is Outcome.LOST_IN_LIFT

    def test_an_attempt_that_ends_while_closing_is_judged(self) -> None:
        streams = make_streams(ATTEMPT[: CLOSED + 1])
        assert outcome(streams) is Outcome.NO_CONTACT
        press(streams, CLOSED)
        assert outcome(streams) is Outcome.LOST_IN_LIFT

    def test_closing_on_nothing_is_no_contact(self) -> None:
        assert outcome(make_streams(ATTEMPT)) is Outcome.NO_CONTACT

    def test_both_pads_one_after_the_other_is_no_contact(self) -> None:
        streams = make_streams(ATTEMPT)
        press(streams, CLOSED - 1, (0,))
        press(streams, CLOSED, (1,))
        assert outcome(streams) is Outcome.NO_CONTACT

    @pytest.mark.parametrize("body", [b for b in Label if b is not Label.TARGET])
    def test_touching_anything_else_is_no_contact(self, body: Label) -> None:
        streams = make_streams(ATTEMPT)
        press(streams, slice(CLOSED, None), body=body)
        assert outcome(streams) is Outcome.NO_CONTACT

    def test_a_target_that_fell_off_the_table_left_the_workspace(self) -> None:
        streams = held_attempt()
        streams["tactile_body"][-1] = Label.BACKGROUND
        streams["object_pose"][-1, 0, 2] = FELL_OFF - 1e-6
        assert outcome(streams) is Outcome.LEFT_WORKSPACE
        streams["object_pose"][-1, 0, 2] = FELL_OFF + 1e-6
        assert outcome(streams) is Outcome.LOST_IN_HOLD

    def test_height_is_that_of_the_centre_of_mass(self) -> None:
        # The object's frame lies 5 cm above its centre of mass, and at the end on its side.
        com = np.array([0.0, 0.0, -0.05])
        streams = held_attempt()
        streams["object_pose"][-1, 0, 2] = UP + 0.05 + 1e-6
        assert outcome(streams, com) is Outcome.SUCCESS
        streams["object_pose"][-1, 0, 2] = UP + 0.05 - 1e-6
        assert outcome(streams, com) is not Outcome.SUCCESS
        on_its_side = rotation_about((1.0, 0.0, 0.0), np.pi / 2)
        put(streams, "object_pose", -1, transform(on_its_side, (0.0, 0.0, UP + 1e-6)))
        assert outcome(streams, com) is Outcome.SUCCESS

    @given(st.data())
    def test_success_is_what_the_docstring_says_and_nothing_else(self, data: st.DataObject) -> None:
        streams = make_streams(data.draw(st.sampled_from([ATTEMPT, HELD])))
        n = len(streams["phase"])
        heights = st.sampled_from([REST, JUST_BELOW, UP, UP + 0.05, -0.1])
        for record in range(CLOSED, n):
            press(streams, record, tuple(data.draw(st.sets(st.sampled_from([0, 1])))))
            streams["object_pose"][record, 0, 2] = data.draw(heights)
        result = outcome(streams)
        held = n == len(HELD) and (streams["tactile_body"][-1, :, 0] == Label.TARGET).all()
        assert (result is Outcome.SUCCESS) == (held and streams["object_pose"][-1, 0, 2] >= UP)
        after_closing = {Outcome.LEFT_WORKSPACE, Outcome.NO_CONTACT,
                         Outcome.LOST_IN_LIFT, Outcome.LOST_IN_HOLD}  # fmt: skip
        assert result in {Outcome.SUCCESS} | after_closing


class TestTouch:
    def test_touch_is_told_per_pad_and_record(self) -> None:
        streams = make_streams(ATTEMPT)
        press(streams, 3, (0,))
        press(streams, 4, (1,), slot=MAX_CONTACTS - 1)
        expected = np.zeros((len(ATTEMPT), 2), bool)
        expected[3, 0] = expected[4, 1] = True
        np.testing.assert_array_equal(touching(streams), expected)

    def test_the_table_is_never_touch_of_the_target(self) -> None:
        streams = make_streams(ATTEMPT)
        press(streams, slice(None), body=Label.TABLE)
        assert not touching(streams).any()
        np.testing.assert_array_equal(pad_normal_force(streams), np.zeros((len(ATTEMPT), 2)))

    def test_normal_forces_of_the_contacts_add_up(self) -> None:
        streams = make_streams(ATTEMPT)
        press(streams, 5, (0,), slot=0, force=(0.0, 2.0, 0.0))
        press(streams, 5, (0,), slot=7, force=(0.0, 0.5, 0.0))
        press(streams, 5, (1,), slot=3, force=(0.0, 4.0, 0.0))
        expected = np.zeros((len(ATTEMPT), 2))
        expected[5] = 2.5, 4.0
        np.testing.assert_array_equal(pad_normal_force(streams), expected)

    def test_friction_and_other_bodies_are_no_normal_force(self) -> None:
        streams = make_streams(ATTEMPT)
        press(streams, 5, (0,), slot=0, force=(3.0, 2.0, -4.0))
        press(streams, 5, (0,), slot=1, force=(0.0, 8.0, 0.0), body=Label.TABLE)
        assert pad_normal_force(streams)[5, 0] == 2.0

    def test_a_tilted_normal_counts_with_its_part_of_the_force(self) -> None:
        streams = make_streams(ATTEMPT)
        press(streams, 5, (0,), force=(3.0, 4.0, 0.0))
        streams["tactile_normal"][5, 0, 0] = 0.6, 0.8, 0.0
        assert pad_normal_force(streams)[5, 0] == pytest.approx(5.0)


class TestTargetCom:
    def test_the_centre_of_mass_goes_with_the_objects_pose(self) -> None:
        streams = make_streams(ATTEMPT)
        quarter = rotation_about((0.0, 0.0, 1.0), np.pi / 2)
        put(streams, "object_pose", 2, transform(quarter, (0.5, 0.1, 0.2)))
        com = target_com(streams, np.array([0.03, 0.0, 0.01]))
        assert com.shape == (len(ATTEMPT), 3)
        np.testing.assert_allclose(com[2], [0.5, 0.13, 0.21], atol=1e-7)
        np.testing.assert_allclose(com[0], [0.03, 0.0, REST + 0.01], atol=1e-7)

    def test_no_records_have_no_centres(self) -> None:
        assert target_com(make_streams(()), CENTERED).shape == (0, 3)


class TestMeasure:
    def test_an_attempt_that_never_closed_has_no_measurements(self) -> None:
        for phases in ((), ATTEMPT[:4]):
            measured = measure(make_streams(phases), CENTERED, REST)
            assert measured.hold_duration == 0.0
            rest = dataclasses.asdict(measured)
            assert (rest.pop("hold_duration"), rest.pop("shake_level")) == (0.0, 0.0)
            assert all(math.isnan(value) for value in rest.values())
            assert len(rest) == len(dataclasses.fields(Measurements)) - 2

    @given(
        st.integers(0, 2**32 - 1),
        st.floats(0.0, 0.05),
        st.floats(0.0, 3.0),
        st.tuples(*[st.floats(-1.0, 1.0)] * 3).filter(lambda v: np.linalg.norm(v) > 0.1),
    )
    def test_slip_is_measured_in_the_moving_hand(
        self, seed: int, distance: float, angle: float, axis: tuple[float, float, float]
    ) -> None:
        rng = np.random.default_rng(seed)
        com = rng.uniform(-0.03, 0.03, 3)
        streams = held_attempt()
        direction = np.asarray(axis) / np.linalg.norm(axis)
        T_tcp_object = Pose((0.01, -0.02, 0.005), tuple(rng.normal(size=4).tolist())).matrix()
        # The object turns about its centre of mass, which goes a known way.
        R = rotation_about(direction, angle) @ T_tcp_object[:3, :3]
        place = T_tcp_object[:3, 3] + T_tcp_object[:3, :3] @ com + distance * direction
        T_tcp_slipped = transform(R, place - R @ com)
        for record in range(len(HELD)):
            hand = Pose(tuple(rng.uniform(-0.5, 0.5, 3)), tuple(rng.normal(size=4))).matrix()
            put(streams, "tcp_pose", record, hand)
            before = record <= CLOSED
            put(streams, "object_pose", record, hand @ (T_tcp_object if before else T_tcp_slipped))
        measured = measure(streams, com, REST)
        assert measured.slip_distance == pytest.approx(distance, abs=1e-6)
        assert measured.slip_angle == pytest.approx(angle, abs=1e-5)

    def test_the_way_before_the_closing_ends_is_no_slip(self) -> None:
        streams = held_attempt()
        streams["tcp_pose"][:, 2] = streams["object_pose"][:, 0, 2]
        streams["object_pose"][:CLOSED, 0, 0] = 0.3
        measured = measure(streams, CENTERED, REST)
        assert (measured.slip_distance, measured.slip_angle) == (0.0, 0.0)

    def test_lift_height_is_the_rise_at_the_end(self) -> None:
        streams = held_attempt()
        streams["object_pose"][-2, 0, 2] = 5.0
        streams["object_pose"][-1, 0, 2] = 0.25
        assert measure(streams, CENTERED, REST).lift_height == 0.25 - REST

    def test_the_weakest_moment_of_either_pad_is_the_grip_force(self) -> None:
        streams = held_attempt()
        press(streams, LIFTED + 2, (1,), force=(0.0, 0.75, 0.0))
        press(streams, LIFTED, force=(0.0, 0.125, 0.0))  # in the lift, not in the hold
        assert measure(streams, CENTERED, REST).min_grip_force == 0.75

    def test_a_lost_touch_is_no_grip_force(self) -> None:
        streams = held_attempt()
        streams["tactile_body"][-1, 0] = Label.TABLE
        assert measure(streams, CENTERED, REST).min_grip_force == 0.0

    def test_hold_duration_counts_the_records_with_both_pads_after_the_lift(self) -> None:
        streams = held_attempt()
        assert measure(streams, CENTERED, REST).hold_duration == pytest.approx(5 / HZ)
        streams["tactile_body"][-2, 0] = Label.BACKGROUND
        streams["tactile_body"][-1, 1] = Label.BACKGROUND
        assert measure(streams, CENTERED, REST).hold_duration == pytest.approx(3 / HZ)

    def test_without_a_hold_there_is_no_grip_force_and_no_duration(self) -> None:
        streams = make_streams(ATTEMPT)
        press(streams, slice(CLOSED, None))
        measured = measure(streams, CENTERED, REST)
        assert math.isnan(measured.min_grip_force)
        assert measured.hold_duration == 0.0
        assert measured.lift_height == 0.0

    def test_measuring_leaves_the_streams_alone(self) -> None:
        streams = held_attempt()
        for array in streams.values():
            array.flags.writeable = False
        measure(streams, CENTERED, REST)
        outcome(streams)


def shaken_attempt(*levels: float, lost_in: float | None = None) -> Streams:
    """Return a held attempt with four records of shake at each level; it may be lost in one."""
    streams = make_streams(HELD + (Phase.SHAKE,) * (4 * len(levels)))
    press(streams, slice(CLOSED, None))
    streams["object_pose"][LIFTED:, 0, 2] = UP + 0.05
    streams["shake_level"][len(HELD) :] = np.repeat(levels, 4)
    if lost_in is not None:
        gone = np.flatnonzero(streams["shake_level"] == lost_in)[1]
        streams["tactile_body"][gone:] = Label.BACKGROUND
        streams["object_pose"][gone:, 0, 2] = REST
    return streams


class TestShake:
    @pytest.mark.parametrize(("lost_in", "survived"), [(None, 1.0), (1.0, 0.5), (0.5, 0.0)])
    def test_the_level_before_the_loss_is_survived(
        self, lost_in: float | None, survived: float
    ) -> None:
        streams = shaken_attempt(0.5, 1.0, lost_in=lost_in)
        assert measure(streams, CENTERED, REST).shake_level == survived

    @pytest.mark.parametrize(
        ("lost_in", "asked", "expected"),
        [
            (None, 1.0, Outcome.SUCCESS),
            (1.0, 1.0, Outcome.LOST_IN_SHAKE),
            (1.0, 0.5, Outcome.SUCCESS),
            (0.5, 0.5, Outcome.LOST_IN_SHAKE),
            (0.5, 0.0, Outcome.SUCCESS),
        ],
    )
    def test_success_asks_for_the_level_of_the_thresholds(
        self, lost_in: float | None, asked: float, expected: Outcome
    ) -> None:
        thresholds = LabelConfig(min_lift=0.125, min_shake=asked)
        streams = shaken_attempt(0.5, 1.0, lost_in=lost_in)
        assert judge(streams, CENTERED, REST, thresholds) is expected

    def test_a_touch_by_one_pad_at_a_levels_end_is_no_survival(self) -> None:
        streams = shaken_attempt(0.5, 1.0)
        streams["tactile_body"][len(HELD) + 3, 0] = Label.BACKGROUND
        assert measure(streams, CENTERED, REST).shake_level == 0.0

    def test_the_lift_is_that_of_the_hold_whatever_the_shake_does(self) -> None:
        streams = shaken_attempt(0.5, lost_in=0.5)
        assert measure(streams, CENTERED, REST).lift_height == pytest.approx(0.175)

    def test_the_loss_is_dated_by_the_last_touch_of_both_pads(self) -> None:
        streams = shaken_attempt(0.5, 1.0, lost_in=1.0)
        last = len(HELD) + 4
        assert measure(streams, CENTERED, REST).loss_time == streams["timestamp"][last]
        assert math.isnan(measure(held_attempt(), CENTERED, REST).loss_time)


class TestThresholds:
    @pytest.mark.parametrize(
        ("key", "bound"),
        [("min_grip_force", 2.0), ("max_slip_distance", 0.0), ("max_slip_angle", 0.0)],
    )
    def test_a_measurement_at_its_bound_passes_and_beyond_it_is_unstable(
        self, key: str, bound: float
    ) -> None:
        streams = make_streams(HELD)
        press(streams, slice(CLOSED, None))
        for name in ("tcp_pose", "object_pose"):
            streams[name][LIFTED:, ..., 2] = UP
        streams["tcp_pose"][:LIFTED, 2] = REST
        thresholds = dataclasses.replace(LIMIT, **{key: bound})
        assert judge(streams, CENTERED, REST, thresholds) is Outcome.SUCCESS
        if key == "min_grip_force":
            streams["tactile_force"][-2, 1, 0] = (0.0, 1.9, 0.0)
        else:
            put(streams, "object_pose", -1,
                transform(rotation_about((0, 0, 1), 0.1), (0.01, 0.0, UP)))  # fmt: skip
        assert judge(streams, CENTERED, REST, thresholds) is Outcome.UNSTABLE


class TestContact:
    def test_penetration_is_the_deepest_overlap_with_the_target_in_the_hold(self) -> None:
        streams = held_attempt()
        streams["tactile_depth"][CLOSED:, :, 0] = 1e-4
        streams["tactile_depth"][-2, 1, 0] = 3e-4
        streams["tactile_depth"][CLOSED, 0, 0] = 9e-4  # before the hold
        press(streams, -1, (0,), body=Label.TABLE, slot=1)
        streams["tactile_depth"][-1, 0, 1] = 9e-4  # not the target
        assert measure(streams, CENTERED, REST).max_penetration == pytest.approx(3e-4)

    def test_the_area_is_that_of_the_points_hull_on_the_pad(self) -> None:
        streams = held_attempt()
        corners = [(-0.01, -0.02), (0.01, -0.02), (0.01, 0.02), (-0.01, 0.02), (0.0, 0.0)]
        for slot, (x, z) in enumerate(corners):
            press(streams, -1, (0,), slot=slot)
            streams["tactile_position"][-1, 0, slot] = (x, 0.0, z)
        # 8 cm2 on the left pad, a single point on the right one
        assert measure(streams, CENTERED, REST).contact_area == pytest.approx(4e-4)
