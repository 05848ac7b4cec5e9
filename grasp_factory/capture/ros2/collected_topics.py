"""Which topics are collected: those that are named, all, or those of a usual mobile robot."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from grasp_factory.capture.ros2.discovery import PublishedTopic, TopicWatch
from grasp_factory.capture.ros2.network import Participant
from grasp_factory.capture.ros2.topic_rates import can_be_collected
from grasp_factory.errors import CaptureError, UsageError

ALL = "all"
USUAL_TOPICS = (
    "/camera/color/image_raw",
    "/camera/aligned_depth_to_color/image_raw",
    "/camera/color/camera_info",
    "/imu/data",
    "/odom",
    "/cmd_vel",
    "/joint_states",
)
"""Collected if none are named."""
MORE_TOPICS = ("/scan", "/tf", "/tf_static")
"""Collected with them where they are there."""
_POLL_S, _SETTLE_S = 0.05, 1.0


@dataclass(frozen=True, slots=True, kw_only=True)
class ChosenTopics:
    """The topics to collect, and why others are not."""

    topics: Mapping[str, PublishedTopic]
    left_out: Mapping[str, str]
    """Reasons by name."""


def topics_to_collect(
    participant: Participant, names: Sequence[str], wait_s: float
) -> ChosenTopics:
    """Return the topics to collect as soon as they are published.

    Args:
        participant: a member of their domain.
        names: the topics; ``all`` alone for all that are there, none for the usual ones that are.
        wait_s: how long to wait.

    Raises:
        CaptureError: if a named topic, or without names any, is not published in time.
        UsageError: if messages of a named topic cannot be written.
    """
    watch = TopicWatch(participant)
    if names and list(names) != [ALL]:
        found = watch.wait_for(names, wait_s)
        for topic in found.values():
            if why := _reason(topic):
                raise UsageError(f"{topic.name} cannot be collected: {why}")
        return ChosenTopics(topics=found, left_out={})
    wanted = () if names else (*USUAL_TOPICS, *MORE_TOPICS)
    found = _settled(watch, wanted, wait_s)
    left_out = {name: why for name, topic in found.items() if (why := _reason(topic))}
    left_out |= {name: "nobody publishes it" for name in wanted if name not in found}
    topics = {name: topic for name, topic in found.items() if name not in left_out}
    if not topics:
        what = f"any of {', '.join(USUAL_TOPICS)}" if wanted else "any topic"
        raise CaptureError(f"nobody publishes {what} within {wait_s:g} s: name --topics")
    return ChosenTopics(topics=topics, left_out=left_out)


def _settled(watch: TopicWatch, wanted: Sequence[str], wait_s: float) -> dict[str, PublishedTopic]:
    """Return what is there when no more topics come."""
    end, since = time.monotonic() + wait_s, time.monotonic()
    before: set[str] = set()
    while True:
        there = watch.topics()
        found = {name: there[name] for name in wanted or there if name in there}
        now = time.monotonic()
        if set(found) != before:
            before, since = set(found), now
        if (found and now - since >= _SETTLE_S) or now >= end:
            return found
        time.sleep(_POLL_S)


def _reason(topic: PublishedTopic) -> str:
    """Return why a topic's messages cannot be written; empty if they can."""
    if can_be_collected(topic):
        return ""
    if len(topic.kinds) > 1:
        return f"its publishers send several types: {', '.join(topic.kinds)}"
    return f"{topic.kinds[0]} is no type of ROS 2 Humble"
