"""Wrong options of the commands for topics are refused with one line that says what is valid."""

from __future__ import annotations

from collections.abc import Callable

import pytest
from support.places import TINY

Complaint = Callable[..., tuple[int, str]]


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (("--rate", "fast"), "--rate: got 'fast', valid: 0.001 to 1000, or max"),
        (("--remap", "/a"), "--remap: got '/a', valid: /old:=/new"),
        (("--remap", "/imu/data:=imu"), "topic 'imu', valid: a name such as"),
        (("--remap", "/imu/data:=/label"), "--remap: two topics would be '/label'"),
        (("--clock", "--remap", "/imu/data:=/clock"), "--clock: the recording has a topic /clock;"),
        (("--topics", "/imu/dota"), "unknown topic '/imu/dota'; did you mean '/imu/data'?"),
        (("--domain", "500"), "500 is not in the range 0<=x<=232"),
        (("--interface", "a b"), "interface: got 'a b', valid: a network interface"),
    ],
)
def test_a_wrong_option_is_refused(complaint: Complaint, options: tuple[str], said: str) -> None:
    code, line = complaint("capture", "publish", TINY, 0, "--domain", 77, *options)
    assert code == 2
    assert said in line


def test_a_store_without_the_number_of_an_episode_is_refused(complaint: Complaint) -> None:
    code, line = complaint("capture", "publish", TINY, "--domain", 77)
    assert code == 2
    assert "tiny.zarr is a store: name the EPISODE to play, such as 0" in line
