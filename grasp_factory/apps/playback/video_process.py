"""Writing the video of a stored attempt in a process with limits: a stranger may have made it."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NoReturn

from grasp_factory.apps.playback.playback import VideoPlan, View, draw_video, plan_video
from grasp_factory.core.executors import ProcessLimits, SendMessage
from grasp_factory.core.limits import CHUNK, MEMORY, VIDEO_CPU
from grasp_factory.core.output_file import written_aside
from grasp_factory.curation import isolation
from grasp_factory.dataset.dataset import Dataset
from grasp_factory.errors import StoreError

LEAST_S = 8
"""Processor time for the smallest video, s."""
PIXELS_PER_S = 500_000
"""Pixels for another second: a sixth of what a camera on the hand, the slowest, makes."""


@dataclass(frozen=True, slots=True, kw_only=True)
class VideoJob:
    """A video that is to be drawn; its plan was made before, and is made again from this."""

    store: Path
    index: int
    out: Path
    view: View
    partial: Path
    """An empty file to write to."""


@dataclass(frozen=True, slots=True, kw_only=True)
class WrittenVideo:
    """A video that was written."""

    path: str
    frames: int
    fps: float
    size: tuple[int, int]
    """Width and height, pixels, with the caption."""


def write_video(plan: VideoPlan, on_frame: Callable[[], None] = lambda: None) -> WrittenVideo:
    """Write the video of a stored attempt, and call ``on_frame`` after each frame.

    Raises:
        StoreError: if it cannot be written, data embedded in the store are damaged, or drawing ends
            the process.
        LimitError: if drawing needs more memory or time than the limits allow.
        RecipeError: if an object of the episode cannot be loaded.
    """
    path, frames = plan.dataset.path, len(plan.times)

    def lost(_: Any, why: str) -> NoReturn:
        raise StoreError(f"episode {plan.index} of {path}: drawing ended its process ({why})")

    def drawn(_: Any) -> None:
        on_frame()

    with written_aside(plan.out) as partial:
        job = VideoJob(store=path, index=plan.index, out=plan.out, view=plan.view, partial=partial)
        executor = isolation.isolated(limits=_limits(plan))
        executor.run(draw, [job], drawn, lost, isolation.patience)
    return WrittenVideo(path=str(plan.out), frames=frames, fps=plan.pace.fps, size=plan.size)


def draw(job: VideoJob, report: SendMessage) -> None:
    """Do as ``draw_video`` does, and report each frame."""
    plan = plan_video(Dataset(job.store), job.index, job.out, job.view)
    draw_video(plan, job.partial, lambda: report(None))


def _limits(plan: VideoPlan) -> ProcessLimits:
    """Return limits whose time follows the pixels of the video."""
    seconds = min(VIDEO_CPU.usual, LEAST_S + plan.pixels // PIXELS_PER_S)
    cpu = dataclasses.replace(VIDEO_CPU, usual=seconds)
    return ProcessLimits(what="the video", memory=MEMORY, cpu=cpu, file=CHUNK)
