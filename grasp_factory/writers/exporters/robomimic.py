"""robomimic: one HDF5 file with a demonstration per episode, for imitation learning.

A demonstration has the episode's steps at the rate of its videos. Layout:
https://robomimic.github.io/docs/datasets/overview.html (robomimic 0.3). ``next_obs`` are views of
``obs`` (virtual datasets of HDF5), so that images are stored once.
"""

# ruff: noqa: PLC0415

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from grasp_factory.core.serialization import check_range
from grasp_factory.writers.exporters.base import (
    REAL_ROWS,
    ExportContents,
    Exporter,
    ExportJob,
    ExportPart,
)
from grasp_factory.writers.exporters.selection import Selection
from grasp_factory.writers.exporters.steps import (
    NO_FRAMES,
    NOT_IN_STEPS,
    RATE,
    REAL_STEPS,
    observations,
    steps_of,
    without_frames,
)

FILE = "demo.hdf5"
ENV_TYPE = 2
"""``EnvType.GYM_TYPE`` of robomimic/envs/env_base.py; robomimic needs one of its types."""
MASKS = {"train": "train", "valid": "val", "test": "test"}
"""Names of robomimic's filter keys, and of our splits."""


@dataclass(frozen=True, slots=True, kw_only=True)
class RobomimicSettings:
    """Settings of the format."""

    gzip: int = 1
    """Compression level of images, 0 to 9; 0 for none, which reads fastest."""

    def __post_init__(self) -> None:
        check_range(self, "gzip", 0, 9)


@dataclass(frozen=True, slots=True, kw_only=True)
class ActionBounds:
    """Smallest and largest value of each number of the actions, (J + 1,), rad and m."""

    low: NDArray[np.float64]
    high: NDArray[np.float64]

    @classmethod
    def of(cls, low: Sequence[NDArray[Any]], high: Sequence[NDArray[Any]]) -> ActionBounds:
        """Return the bounds from those of parts, each (J + 1,); NaN is ignored."""
        return cls(
            low=np.fmin.reduce(np.array(low, np.float64)),
            high=np.fmax.reduce(np.array(high, np.float64)),
        )

    @property
    def offset(self) -> NDArray[np.float64]:
        """The middle, which becomes 0."""
        return (self.low + self.high) / 2

    @property
    def scale(self) -> NDArray[np.float64]:
        """Half of the range; 1 for a number that is constant."""
        half = (self.high - self.low) / 2
        return np.where(half > 0, half, 1.0)


def excludes(episodes: Selection, settings: RobomimicSettings) -> Mapping[str, NDArray[np.bool_]]:
    """Exclude episodes without video frames.

    Raises:
        UsageError: if the stores have no videos.
    """
    return {NO_FRAMES: without_frames(episodes)}


def write_part(job: ExportJob, part: ExportPart) -> ActionBounds:
    """Write the demonstrations of some episodes to a file of their own; return their actions'."""
    from grasp_factory.writers.exporters.hdf5_file import NewHdf5File, add_next_view

    low, high = [], []
    with NewHdf5File(_part_file(job, part.number)) as new:
        for place, episode in part.episodes:
            steps = steps_of(episode)
            demo = new.file.create_group(f"data/demo_{place}")
            demo.attrs["num_samples"] = len(steps.record)
            demo["actions_absolute"] = steps.action
            demo["rewards"] = steps.reward
            demo["dones"] = np.append(np.zeros(len(steps.record) - 1, np.int64), 1)
            now, after = demo.create_group("obs"), demo.create_group("next_obs")
            for name, values in observations(episode, steps).items():
                storage = _storage(values, job.settings.gzip)
                add_next_view(after, name, now.create_dataset(name, data=values, **storage))
            low.append(np.fmin.reduce(steps.action))
            high.append(np.fmax.reduce(steps.action))
            new.check()
    return ActionBounds.of(low, high)


def _storage(values: NDArray[Any], gzip: int) -> dict[str, Any]:
    """Return how HDF5 stores an observation: images frame by frame."""
    is_image = values.ndim == 4 and values.dtype == np.uint8
    return {"chunks": (1, *values.shape[1:]), "compression": gzip} if is_image and gzip else {}


def finish(job: ExportJob, parts: Sequence[ActionBounds]) -> None:
    """Join the parts' files; scale all actions to [-1, 1]."""
    import h5py

    from grasp_factory.writers.exporters.hdf5_file import NewHdf5File

    bounds = ActionBounds.of([part.low for part in parts], [part.high for part in parts])
    with NewHdf5File(job.folder / FILE) as new:
        data = new.file.create_group("data")
        data.attrs["total"] = int(job.episodes.column("n_video").sum())
        data.attrs["env_args"] = json.dumps(_environment(job.episodes))
        data.attrs["action_offset"] = bounds.offset
        data.attrs["action_scale"] = bounds.scale
        for number in range(len(parts)):
            path = _part_file(job, number)
            with h5py.File(path, "r") as part:
                for name in part["data"]:
                    part.copy(f"data/{name}", data)
                    action = data[name]["actions_absolute"][()].astype(np.float64)
                    scaled = (action - bounds.offset) / bounds.scale
                    data[name]["actions"] = np.clip(scaled, -1.0, 1.0).astype(np.float32)
                    new.check()
            path.unlink()
        for name, demos in _masks(job.episodes).items():
            new.file[f"mask/{name}"] = np.array(demos, "S")


def _part_file(job: ExportJob, number: int) -> Path:
    return job.aside / f"{number:08d}.hdf5"


def _environment(episodes: Selection) -> dict[str, Any]:
    """Return the metadata that robomimic would make its simulator from."""
    config = episodes.config
    return {
        "env_name": "grasp-factory",
        "type": ENV_TYPE,
        "env_kwargs": {
            "robot": config.robot,
            "control_freq": config.video_hz,
            "cameras": list(config.cameras),
        },
    }


def _masks(episodes: Selection) -> dict[str, list[str]]:
    """Return the demonstrations of each filter key: the splits, the successes, and both."""
    split, success = episodes.column("split"), episodes.column("success")
    masks = {name: split == word for name, word in MASKS.items()}
    masks |= {"success": success, **{f"success_{name}": success & m for name, m in masks.items()}}
    return {name: [f"demo_{k}" for k in np.flatnonzero(mask)] for name, mask in masks.items()}


ROBOMIMIC = Exporter(
    name="robomimic",
    description="one HDF5 file of demonstrations at the videos' rate, for robomimic",
    contents=ExportContents(
        written=("streams/*", "videos/*"),
        left_out=NOT_IN_STEPS,
        treatment={
            "rate": f"{RATE}; records between two frames are left out",
            "action": "joint positions and gripper width that are commanded at the next step,"
            " scaled to [-1, 1] by the bounds of all actions in the file: actions * action_scale +"
            " action_offset (attributes of the group data); actions_absolute has them in rad and m",
            "reward": "rewards: the sum up to the next step, so 1 at the end of a success",
            "split": "mask/train, mask/valid (our val) and mask/test; mask/success has the"
            " successes, and mask/success_train, ... those of a split",
            "no video": "episodes without video frames are not in the file",
            "no grasp": "the robot does not move and there are no video frames",
            "NaN": "kept: tactile_* have NaN where there is no contact point",
            REAL_ROWS: REAL_STEPS,
            "truth": "object_pose is the simulator's truth, which a real robot does not observe",
            "simulator": "robomimic cannot run the episodes: env_args name no simulator of it",
        },
    ),
    excludes=excludes,
    write_part=write_part,
    finish=finish,
    parameters=RobomimicSettings,
    libraries=("h5py",),
    extra="robomimic",
)
