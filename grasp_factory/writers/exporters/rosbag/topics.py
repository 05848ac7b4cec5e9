"""Topics, stamped messages, and the clock of a bag."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import count
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from grasp_factory.core.episode import Episode
from grasp_factory.core.field import Field
from grasp_factory.writers.exporters.selection import Selection

if TYPE_CHECKING:
    from grasp_factory.writers.exporters.rosbag.message_maker import MessageMaker

START_NS = 10**9
"""Stamp of the simulation time 0: to tf, the stamp 0 means the latest transform."""
_NAME = re.compile(r"[A-Za-z][A-Za-z0-9]*(_[A-Za-z0-9]+)*")
"""Names in ROS 2: https://design.ros2.org/articles/topic_and_service_names.html"""
_LATEST_S = 2**31 - 2
"""The seconds of a stamp are a signed 32-bit number."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Topic:
    """A topic of a bag."""

    name: str
    kind: str
    """Type of its messages."""
    is_latched: bool = False
    """Whether subscribers that come later get its last message, too."""


class StampedMessage(NamedTuple):
    """A message and when it was sent."""

    stamp_ns: int
    topic: Topic
    message: Any


@dataclass(frozen=True, slots=True, kw_only=True)
class BagScene:
    """What the messages of an episode are made from."""

    episode: Episode
    fields: Mapping[str, Field]
    """The store's arrays by path."""
    joint_names: list[str]
    cameras: Mapping[str, str]
    """The name of each camera in topics and frames."""
    make: MessageMaker


def scene_of(episodes: Selection, place: int, episode: Episode, make: MessageMaker) -> BagScene:
    """Return what the messages of an episode of an export are made from."""
    store, _ = episodes.origin(place)
    return BagScene(
        episode=episode,
        fields=episodes.fields,
        joint_names=joint_names(episodes.sources[store].attributes, episode),
        cameras=camera_names(list(episode.cameras)),
        make=make,
    )


def joint_names(attributes: Mapping[str, Any], episode: Episode) -> list[str]:
    """Return the names of the robot's joints; their numbers where the store does not tell."""
    joints = episode.streams["joint_positions"].shape[1]
    robot = attributes.get("robot")
    names = robot.get("joint_names") if isinstance(robot, Mapping) else None
    if isinstance(names, list) and [type(name) for name in names] == [str] * joints:
        return names
    return [f"joint_{k}" for k in range(1, joints + 1)]


def camera_names(cameras: Sequence[str]) -> dict[str, str]:
    """Return for each camera a name that ROS can hold, each another: its own if ROS can hold it."""
    valid = {name for name in cameras if _NAME.fullmatch(name)}
    free = (f"camera_{k}" for k in count() if f"camera_{k}" not in valid)
    return {name: name if name in valid else next(free) for name in cameras}


def stamps(seconds: NDArray[np.float64]) -> list[int]:
    """Return simulation times as stamps, ns; a time that ROS cannot hold becomes the nearest."""
    whole = np.rint(np.clip(np.nan_to_num(seconds), -1.0, _LATEST_S) * 1e9).astype(np.int64)
    found: list[int] = (whole + START_NS).tolist()
    return found


def end_stamp(episode: Episode) -> int:
    """Return the stamp of the images after the attempt, ns: that of the last record."""
    return max(stamps(episode.streams["timestamp"]), default=START_NS)
