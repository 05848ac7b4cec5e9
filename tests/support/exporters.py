"""Two exporters as a user would write them: one writes a text file, the other many files."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from grasp_factory.core.serialization import check_range
from grasp_factory.writers.exporters import (
    ExportContents,
    Exporter,
    ExportJob,
    ExportPart,
    NoSettings,
)
from grasp_factory.writers.exporters.selection import Selection


@dataclass(frozen=True, slots=True, kw_only=True)
class LinesSettings:
    """Settings of ``lines``."""

    digits: int = 3
    """Decimal places of numbers."""

    def __post_init__(self) -> None:
        check_range(self, "digits", 0, 15)


def only_attempts(episodes: Selection, settings: LinesSettings) -> Mapping[str, NDArray[np.bool_]]:
    return {"the robot did not move": episodes.column("n_steps") == 0}


def write_lines(job: ExportJob, part: ExportPart) -> list[str]:
    lines = []
    for _, episode in part.episodes:
        lift = round(float(episode.columns["lift_height"]), job.settings.digits)
        lines.append(json.dumps({"row": episode.spec.index, "lift": lift}))
    return lines


def join_lines(job: ExportJob, parts: Sequence[list[str]]) -> None:
    text = "".join(f"{line}\n" for lines in parts for line in lines)
    (job.folder / "lines.jsonl").write_text(text, encoding="utf-8")


def one_by_one(episodes: Selection, settings: NoSettings) -> list[list[int]]:
    return [[place] for place in range(len(episodes))]


def write_images(job: ExportJob, part: ExportPart) -> None:
    for place, episode in part.episodes:
        for camera, frames in episode.cameras.items():
            data = np.ascontiguousarray(frames.rgb[0]).tobytes()
            (job.folder / f"{place:06}_{camera}.bin").write_bytes(data)


LINES = Exporter(
    name="lines",
    description="a line of JSON for each episode",
    contents=ExportContents(
        written=(),
        left_out={"*": "a line holds the row and the lift"},
        treatment={"no attempt": "the episode is left out"},
    ),
    excludes=only_attempts,
    write_part=write_lines,
    finish=join_lines,
    parameters=LinesSettings,
)
IMAGES = Exporter(
    name="images",
    description="a file of raw pixels for each camera",
    contents=ExportContents(written=("cameras/*/rgb",), left_out={"*": "it is no colour image"}),
    split=one_by_one,
    write_part=write_images,
)
