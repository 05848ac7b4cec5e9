"""Messages become payloads of devices, and what does not fit is refused."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from grasp_factory.capture.bags.payloads import (
    colour_pixels,
    depth_pixels,
    imu_reading,
    joint_reading,
    wrench_reading,
)
from grasp_factory.capture.bags.pixel_decoding import decode_image
from grasp_factory.capture.ros2.message_types import decoded
from grasp_factory.capture.ros2.stamp_pairs import StampPairs
from grasp_factory.writers.exporters.rosbag.bag_files import ros2_types
from grasp_factory.writers.exporters.rosbag.message_maker import MessageMaker

MAKE = MessageMaker(ros2_types())
IMU, WRENCH, JOINTS, IMAGE = (
    "sensor_msgs/msg/Imu",
    "geometry_msgs/msg/WrenchStamped",
    "sensor_msgs/msg/JointState",
    "sensor_msgs/msg/Image",
)


def there_and_back(kind: str, **values: Any) -> Any:
    data = ros2_types().serialize_cdr(MAKE(kind, **values), kind)
    return decoded(kind, bytes(data))


def test_an_imu_has_specific_force_and_angular_velocity() -> None:
    force, rate = MAKE.vector([0.1, 0.2, 9.8]), MAKE.vector([1.0, 2.0, 3.0])
    found = imu_reading(there_and_back(IMU, linear_acceleration=force, angular_velocity=rate))
    assert found.specific_force.tolist() == [0.1, 0.2, 9.8]
    assert found.angular_velocity.tolist() == [1.0, 2.0, 3.0]
    assert np.isnan(found.temperature)


def test_a_wrench_is_force_and_torque() -> None:
    force, torque = MAKE.vector([1.0, 2.0, 3.0]), MAKE.vector([4.0, 5.0, 6.0])
    wrench = MAKE("geometry_msgs/msg/Wrench", force=force, torque=torque)
    assert wrench_reading(there_and_back(WRENCH, wrench=wrench)).wrench.tolist() == [
        1,
        2,
        3,
        4,
        5,
        6,
    ]


def test_joints_are_arm_and_gripper_and_the_command_is_found_by_name() -> None:
    state = there_and_back(
        JOINTS,
        name=["gripper", "a", "b"],
        position=np.array([0.04, 1.0, 2.0]),
        effort=np.array([9.0, 0.1, 0.2]),
    )
    command = there_and_back(JOINTS, name=["b", "gripper"], position=np.array([2.5, 0.02]))
    found = joint_reading(state, command, "gripper")
    assert found.positions.tolist() == [1.0, 2.0]
    assert found.torques.tolist() == [0.1, 0.2]
    assert (found.gripper_width, found.gripper_width_target, found.gripper_force) == (0.04, 0.02, 9)
    np.testing.assert_array_equal(found.position_targets, [np.nan, 2.5])
    assert np.isnan(found.velocities).all()


def test_without_command_and_gripper_what_is_not_there_is_nan() -> None:
    found = joint_reading(there_and_back(JOINTS, name=["a"], position=np.ones(1)), None, "gripper")
    assert np.isnan([found.gripper_width, found.gripper_force, *found.position_targets]).all()


@pytest.mark.parametrize(
    "values",
    [
        {"name": ["a", "b"], "position": np.ones(3)},
        {"name": ["a", "a"]},
        {"name": [f"j{k}" for k in range(101)]},
    ],
)
def test_joints_that_do_not_fit_are_refused(values: dict[str, Any]) -> None:
    with pytest.raises(ValueError, match="joints"):
        joint_reading(there_and_back(JOINTS, **values), None, "gripper")


@given(st.sampled_from(["rgb8", "bgr8", "mono8"]), st.integers(1, 7), st.integers(1, 7))
def test_images_of_colours_are_rgb(encoding: str, height: int, width: int) -> None:
    channels = 1 if encoding == "mono8" else 3
    pixels = np.arange(height * width * channels, dtype=np.uint8)
    sizes = {"height": height, "width": width, "step": width * channels}
    image = there_and_back(IMAGE, encoding=encoding, data=pixels, **sizes)
    found = colour_pixels(decode_image(image))
    wanted = pixels.reshape(height, width, channels)
    wanted = wanted[..., ::-1] if encoding == "bgr8" else wanted
    np.testing.assert_array_equal(found, np.broadcast_to(wanted, (height, width, 3)))


def test_depth_in_metres_becomes_millimetres_and_a_colour_image_is_no_depth() -> None:
    sizes = {"height": 1, "width": 2}
    metres = np.array([0.5, 1.25], np.float32).view(np.uint8)
    depth = decode_image(there_and_back(IMAGE, encoding="32FC1", data=metres, step=8, **sizes))
    assert depth_pixels(depth).tolist() == [[500, 1250]]
    with pytest.raises(ValueError, match="a depth image"):
        colour_pixels(depth)
    grey = there_and_back(IMAGE, encoding="mono8", data=np.ones(2, np.uint8), step=2, **sizes)
    with pytest.raises(ValueError, match="a colour image"):
        depth_pixels(decode_image(grey))


@given(st.binary(max_size=80), st.sampled_from([IMU, WRENCH, JOINTS, IMAGE]))
def test_any_bytes_are_a_message_or_a_value_error(data: bytes, kind: str) -> None:
    try:
        decoded(kind, data)
    except ValueError as error:
        assert kind in str(error)


@given(st.integers(1, 100), st.sets(st.integers(0, 99)), st.sets(st.integers(0, 99)), st.randoms())
def test_each_pair_of_the_same_instant_is_found_once_whatever_comes_first(
    length: int, left_out: set[int], right_out: set[int], random: Any
) -> None:
    pairs: StampPairs[int, int] = StampPairs(4_000_000)
    lefts = [k for k in range(length) if k not in left_out]
    rights = [k for k in range(length) if k not in right_out]
    found = []
    while lefts or rights:
        is_near = not (lefts and rights) or abs(lefts[0] - rights[0]) < 5
        from_left = bool(lefts) and (
            not rights or (random.random() < 0.5 if is_near else lefts[0] < rights[0])
        )
        if from_left:
            k = lefts.pop(0)
            found += pairs.add_left(k * 33_000_000, k)
        else:
            k = rights.pop(0)
            found += pairs.add_right(k * 33_000_000 + 3_000_000, k)
    wanted = set(range(length)) - left_out - right_out
    assert found == [(k, k) for k in sorted(wanted)]


def test_what_waits_for_a_partner_that_never_comes_is_bounded_and_counted() -> None:
    pairs: StampPairs[int, int] = StampPairs(1)
    for k in range(100):
        assert pairs.add_left(k * 10, k) == []
    assert pairs.single == 36
