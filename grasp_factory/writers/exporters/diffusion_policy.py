"""Diffusion Policy and UMI: a replay buffer, one Zarr file of steps of all episodes.

``data/*`` are arrays over the steps of all episodes, and ``meta/episode_ends`` says where each
episode ends. The file is a zip of Zarr version 2, as those projects read no other. Layouts:
https://github.com/real-stanford/diffusion_policy (diffusion_policy/common/replay_buffer.py) and
https://github.com/real-stanford/universal_manipulation_interface
(scripts_slam_pipeline/07_generate_replay_buffer.py).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from enum import Enum
from typing import Any

import numpy as np
from numpy.typing import NDArray

from grasp_factory.core.episode import Episode
from grasp_factory.core.splits import SPLITS
from grasp_factory.writers.exporters.base import (
    REAL_ROWS,
    ExportContents,
    Exporter,
    ExportJob,
    ExportPart,
)
from grasp_factory.writers.exporters.replay_buffer_file import (
    BufferPart,
    FramesFile,
    write_replay_buffer,
)
from grasp_factory.writers.exporters.selection import Selection
from grasp_factory.writers.exporters.steps import (
    NO_FRAMES,
    NOT_IN_STEPS,
    RATE,
    REAL_STEPS,
    EpisodeSteps,
    steps_of,
    without_frames,
)

FILE = "replay_buffer.zarr.zip"


class BufferNames(Enum):
    """Which project's names the arrays have."""

    DIFFUSION_POLICY = "diffusion_policy"
    UMI = "umi"


@dataclass(frozen=True, slots=True, kw_only=True)
class DiffusionPolicySettings:
    """Settings of the format."""

    names: BufferNames = BufferNames.DIFFUSION_POLICY
    """With ``umi`` there is the hand's pose as UMI has it, and no array ``action``."""


def excludes(
    episodes: Selection, settings: DiffusionPolicySettings
) -> Mapping[str, NDArray[np.bool_]]:
    """Exclude episodes without video frames.

    Raises:
        UsageError: if the stores have no videos.
    """
    return {NO_FRAMES: without_frames(episodes)}


def write_part(job: ExportJob, part: ExportPart) -> BufferPart:
    """Write the steps of some episodes aside: images in a zip, all else in a .npz file."""
    start = 0
    arrays: dict[str, list[NDArray[Any]]] = {}
    aside = job.aside / f"{part.number:08d}"
    with FramesFile(aside.with_suffix(".zip")) as file:
        for _, episode in part.episodes:
            steps = steps_of(episode)
            for name, values in step_arrays(episode, steps, job.settings.names).items():
                arrays.setdefault(name, []).append(values)
            for number, frames in enumerate(steps.images.values()):
                file.add(number, start, frames)
            start += len(steps.record)
    joined: dict[str, Any] = {name: np.concatenate(values) for name, values in arrays.items()}
    np.savez(aside.with_suffix(".npz"), **joined)
    return BufferPart(
        steps=start, frames=aside.with_suffix(".zip"), arrays=aside.with_suffix(".npz")
    )


def step_arrays(
    episode: Episode, steps: EpisodeSteps, names: BufferNames
) -> dict[str, NDArray[Any]]:
    """Return the values of each step that are no images, by name, each (K, ...)."""
    own = _umi_arrays(steps) if names is BufferNames.UMI else _policy_arrays(steps)
    poses = {
        f"camera{number}_T_world_camera": episode.videos[f"{camera}/T_world_camera"]
        for number, camera in enumerate(episode.cameras)
    }
    clock = {"reward": steps.reward, "video_timestamp": episode.videos["timestamp"]}
    return {**own, **steps.streams, **clock, **poses}


def _policy_arrays(steps: EpisodeSteps) -> dict[str, NDArray[Any]]:
    return {"action": steps.action, "state": steps.state}


def _umi_arrays(steps: EpisodeSteps) -> dict[str, NDArray[Any]]:
    """Return the TCP's pose and the gripper's width as UMI has them, with its types."""
    pose = steps.streams["tcp_pose"].astype(np.float64)
    vector = np.concatenate([pose[:, :3], rotation_vectors(pose[:, 3:])], axis=1)
    return {
        "robot0_eef_pos": vector[:, :3].astype(np.float32),
        "robot0_eef_rot_axis_angle": vector[:, 3:].astype(np.float32),
        "robot0_gripper_width": steps.streams["gripper_width"][:, None],
        "robot0_demo_start_pose": np.broadcast_to(vector[0], vector.shape),
        "robot0_demo_end_pose": np.broadcast_to(vector[-1], vector.shape),
    }


def rotation_vectors(quat_xyzw: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return axis times angle (K, 3), rad in [0, pi], of unit quaternions (K, 4)."""
    quat = np.where(quat_xyzw[:, 3:] < 0, -quat_xyzw, quat_xyzw)
    sine = np.sqrt((quat[:, :3] ** 2).sum(axis=1, keepdims=True))
    angle = 2 * np.arctan2(sine, quat[:, 3:])
    tiny = sine < 1e-12
    return np.asarray(quat[:, :3] * np.where(tiny, 2.0, angle / np.where(tiny, 1.0, sine)))


def finish(job: ExportJob, parts: Sequence[BufferPart]) -> None:
    """Join the parts, and write what describes all episodes."""
    episodes = job.episodes
    write_replay_buffer(
        job.folder / FILE,
        parts,
        meta={
            "episode_ends": np.cumsum(episodes.column("n_video"), dtype=np.int64),
            "episode_split": [SPLITS.index(name) for name in episodes.column("split")],
            "episode_success": episodes.column("success"),
        },
        attributes={
            "cameras": list(episodes.config.cameras),
            "splits": list(SPLITS),
            "video_hz": episodes.config.video_hz,
        },
        resolution=episodes.config.resolution,
    )


DIFFUSION_POLICY = Exporter(
    name="diffusion_policy",
    description="a replay buffer at the videos' rate, for Diffusion Policy and UMI",
    contents=ExportContents(
        written=("streams/*", "videos/*"),
        left_out=NOT_IN_STEPS,
        treatment={
            "rate": f"{RATE}; records between two frames are left out",
            "action": "joint positions (rad) and gripper width (m) that are commanded at the next"
            " step; state has the measured ones",
            "names=umi": "robot0_* have the TCP's pose as position and axis times angle, and the"
            " gripper's width; there is no action or state, as UMI uses the poses. UMI's own"
            " images have 224 x 224 pixels: generate with --resolution 224x224",
            "cameras": "camera0_rgb, camera1_rgb, ... in the order of the attribute cameras",
            "split": "meta/episode_split has 0 for train, 1 for val, 2 for test, and"
            " meta/episode_success the label: make an episode_mask of them",
            "reward": "the sum up to the next step, so 1 at the end of a success",
            "no video": "episodes without video frames are not in the file",
            "no grasp": "the robot does not move and there are no video frames",
            "NaN": "kept: tactile_* have NaN where there is no contact point",
            REAL_ROWS: REAL_STEPS,
            "truth": "object_pose is the simulator's truth, which a real robot does not observe",
        },
    ),
    excludes=excludes,
    write_part=write_part,
    finish=finish,
    parameters=DiffusionPolicySettings,
)
