"""An episode as steps at the rate of its videos, for formats of policy learning.

A step is a video frame with the record of the streams at the same time or last before it. The
action of a step is the command of the next step; the last step has the last command. The reward of
a step is the sum over its record and the records up to the next step.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from grasp_factory.core.episode import Episode
from grasp_factory.errors import UsageError
from grasp_factory.writers.exporters.base import REAL_SERIES
from grasp_factory.writers.exporters.selection import Selection

NOT_IN_STEPS = {
    "cameras/*": "the images before and after the attempt belong to no step",
    **dict.fromkeys(
        ("imu/*", *REAL_SERIES),
        "a step has one record of each series, and these devices have many at times of their own",
    ),
}
"""What formats of steps leave out, for ``ExportContents.left_out``."""
RATE = "a step is a video frame with the last record of the streams before it or at the same time"
"""For ``ExportContents.treatment``."""
REAL_STEPS = (
    "a step is an image at the time when it was taken, which is in video_timestamp: steps are not"
    " evenly spaced; what was not measured, such as commands, is NaN"
)
"""For ``ExportContents.treatment``."""
NO_FRAMES = "the robot did not move, so there are no video frames"


@dataclass(frozen=True, slots=True, kw_only=True)
class EpisodeSteps:
    """The K steps of an episode."""

    timestamp: NDArray[np.float64]
    """Seconds since the first step, (K,): the step's number divided by the video's rate."""
    record: NDArray[np.int64]
    """Position of each step's record in the streams, (K,)."""
    images: Mapping[str, NDArray[np.uint8]]
    """Frames by camera, (K, H, W, 3)."""
    state: NDArray[np.float32]
    """Measured joint positions (rad) and gripper width (m), (K, J + 1)."""
    action: NDArray[np.float32]
    """Commanded joint positions (rad) and gripper width (m) of the next step, (K, J + 1)."""
    reward: NDArray[np.float32]
    """1 at the last step of a success, else 0, (K,)."""
    streams: Mapping[str, NDArray[Any]]
    """Every stream at the records of the steps, by name, (K, ...)."""


def steps_of(episode: Episode) -> EpisodeSteps:
    """Return an episode's steps; the episode must have video frames."""
    streams, videos = episode.streams, episode.videos
    count = len(videos["timestamp"])
    found = np.searchsorted(streams["timestamp"], videos["timestamp"], side="right") - 1
    record = np.clip(found, 0, episode.n_steps - 1)
    state = _with_width(streams["joint_positions"], streams["gripper_width"])
    target = _with_width(streams["joint_position_targets"], streams["gripper_width_target"])
    return EpisodeSteps(
        timestamp=np.arange(count) / episode.spec.video_hz,
        record=record,
        images={name: videos[f"{name}/rgb"] for name in episode.cameras},
        state=state[record],
        action=target[np.append(record[1:], episode.n_steps - 1)],
        reward=_sums(streams["reward"], record),
        streams={name: values[record] for name, values in streams.items()},
    )


def observations(episode: Episode, steps: EpisodeSteps) -> dict[str, NDArray[Any]]:
    """Return what is observed at each step, by name, each (K, ...).

    These are the streams without the reward and, for each camera, ``<camera>_image`` and
    ``<camera>_T_world_camera`` with the time ``video_timestamp``.
    """
    videos = {path: values for path, values in episode.videos.items() if "/" in path}
    return {
        **{name: values for name, values in steps.streams.items() if name != "reward"},
        "video_timestamp": episode.videos["timestamp"],
        **{
            path.replace("/rgb", "/image").replace("/", "_"): values
            for path, values in videos.items()
        },
    }


def task_text(family: str) -> str:
    """Return the task of an episode whose target is of a family of objects."""
    return f"Grasp the {family.replace('_', ' ') or 'object'} and lift it."


def without_frames(episodes: Selection) -> NDArray[np.bool_]:
    """Return which episodes have no video frames, (n,).

    Raises:
        UsageError: if the stores have no videos.
    """
    if not episodes.config.video_hz:
        raise UsageError(
            f"{episodes.sources[0].path} has no videos, and the format needs them: generate a"
            " dataset with --video-hz 10"
        )
    none: NDArray[np.bool_] = episodes.column("n_video") == 0
    return none


def _sums(values: NDArray[np.float32], start: NDArray[np.int64]) -> NDArray[np.float32]:
    """Return the sums of the values (T,) from each position ``start`` (K,) up to the next one."""
    before = np.append(np.float32(0), np.cumsum(values, dtype=np.float32))
    return np.diff(before[np.append(start, len(values))])


def _with_width(joints: NDArray[np.float32], width: NDArray[np.float32]) -> NDArray[np.float32]:
    return np.concatenate([joints, width[:, None]], axis=1)
