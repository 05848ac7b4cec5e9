"""Names, types and stamps of messages of ROS 2, without a network."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from grasp_factory.capture.ros2.dds_names import (
    check_topic,
    dds_topic,
    dds_type,
    ros_topic,
    ros_type,
)
from grasp_factory.capture.ros2.message_stamp import stamp_of
from grasp_factory.capture.ros2.message_types import sample_of, sample_type_of, type_hash
from grasp_factory.capture.ros2.network import Ros2Network
from grasp_factory.errors import ConfigError, UsageError
from grasp_factory.writers.exporters.rosbag.bag_files import ros2_types
from grasp_factory.writers.exporters.rosbag.message_maker import MessageMaker

TYPES = sorted(ros2_types().fielddefs)
PARTS = st.lists(st.from_regex(r"[a-z][a-z0-9]{0,8}", fullmatch=True), min_size=1, max_size=4)
IMU, WRENCH = "sensor_msgs/msg/Imu", "geometry_msgs/msg/WrenchStamped"
TRANSFORMS, STRING = "tf2_msgs/msg/TFMessage", "std_msgs/msg/String"


@given(PARTS)
def test_a_topic_has_the_same_name_after_its_way_over_the_wire(parts: list[str]) -> None:
    name = "/" + "/".join(parts)
    check_topic(name)
    assert ros_topic(dds_topic(name)) == name


@pytest.mark.parametrize("name", ["rq/service", "rt", "rt/", "DCPSPublication", "rt/a//b", "rt/\n"])
def test_a_name_on_the_wire_that_is_no_topic_of_ros_is_none(name: str) -> None:
    assert ros_topic(name) is None


@pytest.mark.parametrize("name", ["imu", "/", "/a/", "/1a", "/a__b", "/ü", "/" + "a" * 300])
def test_a_name_that_ros_does_not_have_is_refused(name: str) -> None:
    with pytest.raises(UsageError, match="valid: a name such as /camera"):
        check_topic(name)


@pytest.mark.parametrize("kind", TYPES)
def test_each_type_can_be_made_for_the_wire_and_has_the_hash_of_ros(kind: str) -> None:
    made = sample_type_of(kind)
    made.__idl__.populate()  # type: ignore[attr-defined]
    assert made.__idl__.idl_transformed_typename == dds_type(kind)  # type: ignore[attr-defined]
    assert ros_type(dds_type(kind)) == kind
    assert type_hash(kind).startswith("RIHS01_")


def test_a_sample_carries_the_bytes_as_they_are() -> None:
    kind = sample_type_of(IMU)
    assert sample_of(kind, b"\0\1\0\0abc").serialize() == b"\0\1\0\0abc"
    assert kind.deserialize(b"any").cdr == b"any"  # type: ignore[attr-defined]
    assert kind.deserialize_key(b"any").cdr == b"any"  # type: ignore[attr-defined]


def test_a_type_that_is_none_is_refused_with_the_nearest() -> None:
    with pytest.raises(UsageError, match=r"'sensor_msgs/msg/Imu'.*valid: the types of ROS 2"):
        sample_type_of("sensor_msgs/msg/Imo")


@given(st.integers(1, 2**31 * 10**9 - 1), st.booleans(), st.sampled_from([IMU, WRENCH, TRANSFORMS]))
def test_the_stamp_is_read_without_decoding_the_message(
    stamp: int, is_little: bool, kind: str
) -> None:
    types = ros2_types()
    make = MessageMaker(types)
    if kind == TRANSFORMS:
        message = make(kind, transforms=[make.transform(stamp, "world", "tcp", [0.0] * 7)])
    else:
        message = make(kind, header=make.header(stamp, "frame"))
    data = bytes(types.serialize_cdr(message, kind, little_endian=is_little))
    assert stamp_of(kind, data) == stamp
    assert stamp_of(kind, data[:8]) is None


def test_a_message_without_header_or_with_the_stamp_0_has_no_stamp() -> None:
    types = ros2_types()
    make = MessageMaker(types)
    text = bytes(types.serialize_cdr(make(STRING, data="text"), STRING))
    assert stamp_of(STRING, text) is None
    assert stamp_of(IMU, bytes(types.serialize_cdr(make(IMU), IMU))) is None
    assert stamp_of(IMU, np.zeros(4, np.uint8).tobytes()) is None


@pytest.mark.parametrize(
    "settings", [{"domain_id": 233}, {"domain_id": -1}, {"interface": 'lo"/><Peer'}]
)
def test_a_network_that_cannot_be_is_refused(settings: dict[str, object]) -> None:
    with pytest.raises(ConfigError, match=r"valid: (0 to 232|a network interface)"):
        Ros2Network(**settings)  # type: ignore[arg-type]


def test_only_the_loopback_is_used_if_no_interface_is_named() -> None:
    config = Ros2Network().config()
    assert '<NetworkInterface name="lo" multicast="false"/>' in config
    assert "<AllowMulticast>false</AllowMulticast>" in config
