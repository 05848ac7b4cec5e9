"""Every gripper closes within the time that the length of the streams allows."""

from __future__ import annotations

import dataclasses

import pytest

from grasp_factory.core.config import motion
from grasp_factory.core.config.motion import MotionConfig
from grasp_factory.robots import ROBOTS, RobotModel

# `core` may not import the table of robots, so it has bounds of its own, and these are the tests.
PLACE = "core/config/motion.py"


def too_slow(model: RobotModel) -> list[str]:
    """Return what to change for a robot whose gripper may close longer than streams are."""
    gripper, out = model.gripper, []
    stroke = gripper.max_width / 2.0
    if stroke > motion.MAX_CLOSING_STROKE:
        out.append(
            f"{model.name}: a finger travels {stroke} m, MAX_CLOSING_STROKE is"
            f" {motion.MAX_CLOSING_STROKE} m: raise MAX_CLOSING_STROKE in {PLACE} to {stroke}"
        )
    if gripper.max_finger_speed < motion.SLOWEST_FINGERS:
        out.append(
            f"{model.name}: its fingers reach {gripper.max_finger_speed} m/s, SLOWEST_FINGERS is"
            f" {motion.SLOWEST_FINGERS} m/s: lower SLOWEST_FINGERS in {PLACE} to"
            f" {gripper.max_finger_speed}"
        )
    return out


@pytest.mark.parametrize("name", ROBOTS)
def test_the_streams_are_long_enough_for_its_gripper(name: str) -> None:
    assert too_slow(ROBOTS[name]) == []


@pytest.mark.parametrize("name", ROBOTS)
@pytest.mark.parametrize("closing_speed", [0.01, 0.1, 2.0])
def test_it_closes_within_the_bound_of_the_config(name: str, closing_speed: float) -> None:
    gripper = ROBOTS[name].gripper
    longest = gripper.max_width / 2.0 / min(closing_speed, gripper.max_finger_speed)
    bound = MotionConfig(closing_speed=closing_speed).longest_close_s
    assert longest + motion.CLOSING_SETTLE_S <= bound


def test_a_wide_or_slow_gripper_is_named_with_the_constant_to_change() -> None:
    model = ROBOTS["panda"]
    gripper = dataclasses.replace(model.gripper, max_width=0.2, max_finger_speed=0.01)
    wide, slow = too_slow(dataclasses.replace(model, gripper=gripper))
    assert wide.startswith("panda: ")
    assert "raise MAX_CLOSING_STROKE in core/config/motion.py to 0.1" in wide
    assert "lower SLOWEST_FINGERS in core/config/motion.py to 0.01" in slow
