"""Numbers and paths in a LeRobot dataset that follow from the choice of episodes alone."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from grasp_factory.writers.exporters.lerobot.even_frames import frame_counts
from grasp_factory.writers.exporters.selection import Selection
from grasp_factory.writers.exporters.steps import task_text

FILES_IN_CHUNK = 1000
"""``DEFAULT_CHUNK_SIZE`` in
https://github.com/huggingface/lerobot/blob/v0.4.4/src/lerobot/datasets/utils.py"""
DATA, EPISODES, EXTRAS, VIDEO = "data", "meta/episodes", "extras", "videos"
"""Folders; that of the videos has one for each feature."""


@dataclass(frozen=True, slots=True, kw_only=True)
class FrameNumbering:
    """Numbers of frames and tasks over all episodes."""

    starts: NDArray[np.int64]
    """Number of each episode's first frame, and at the end the number of all frames, (n + 1,)."""
    tasks: tuple[str, ...]
    """Task texts, sorted."""
    task: NDArray[np.int64]
    """Position of each episode's task in ``tasks``, (n,)."""

    def columns(self, place: int) -> dict[str, NDArray[np.int64]]:
        """Return the columns of an episode's frames that number them over all episodes."""
        index = np.arange(self.starts[place], self.starts[place + 1])
        return {
            "episode_index": np.full_like(index, place),
            "index": index,
            "task_index": np.full_like(index, self.task[place]),
        }


def numbering_of(episodes: Selection) -> FrameNumbering:
    """Return the numbers of all frames and tasks; every process finds the same."""
    frames = frame_counts(episodes)
    texts = [task_text(str(family)) for family in episodes.column("object_family")]
    tasks = tuple(sorted(set(texts)))
    number = {text: k for k, text in enumerate(tasks)}
    return FrameNumbering(
        starts=np.concatenate([[0], np.cumsum(frames)]),
        tasks=tasks,
        task=np.array([number[text] for text in texts]),
    )


def chunk_and_file(part: int) -> tuple[int, int]:
    """Return LeRobot's ``chunk_index`` and ``file_index`` of a part."""
    return divmod(part, FILES_IN_CHUNK)


def path_pattern(folder: str, suffix: str) -> str:
    """Return the pattern of the paths in a folder, as info.json has it."""
    return f"{folder}/chunk-{{chunk_index:03d}}/file-{{file_index:03d}}{suffix}"


def file_name(folder: str, suffix: str, part: int) -> str:
    """Return the path of a part's file in the dataset."""
    chunk, file = chunk_and_file(part)
    return path_pattern(folder, suffix).format(chunk_index=chunk, file_index=file)


def new_file(root: Path, folder: str, suffix: str, part: int) -> Path:
    """Return the path of a part's file; its folder exists then.

    Raises:
        OSError: if the folder cannot be made.
    """
    path = root / file_name(folder, suffix, part)
    path.parent.mkdir(parents=True, exist_ok=True)
    return path
