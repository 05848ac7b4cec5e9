"""Two exporters as a user would write them: one makes a file, the other a folder."""

from __future__ import annotations

import json
from dataclasses import dataclass

import numpy as np

from grasp_factory.core.serialization import check_range
from grasp_factory.writers.exporters import ExportContents, Exporter, ExportJob


@dataclass(frozen=True, slots=True, kw_only=True)
class LinesSettings:
    """Settings of ``lines``."""

    digits: int = 3
    """Decimal places of numbers."""

    def __post_init__(self) -> None:
        check_range(self, "digits", 0, 15)


def write_lines(job: ExportJob) -> ExportContents:
    with job.out.open("w", encoding="utf-8") as file:
        for row in job.rows:
            lift = round(float(job.source.value(row, "lift_height")), job.settings.digits)
            outcome = job.source[row].outcome.name
            file.write(json.dumps({"row": row, "outcome": outcome, "lift": lift}) + "\n")
            job.on_episode()
    return ExportContents(
        written=("episodes/outcome", "episodes/lift_height"),
        left_out={"*": "a line holds the outcome and the lift"},
    )


def write_images(job: ExportJob) -> ExportContents:
    job.out.mkdir()
    for i, row in enumerate(job.rows):
        for camera in job.source.config.cameras:
            image = job.source.image(row, camera, "rgb", 0)
            (job.out / f"{i:06}_{camera}.bin").write_bytes(np.ascontiguousarray(image).tobytes())
        job.on_episode()
    return ExportContents(written=("cameras/*/rgb",), left_out={"*": "it is no colour image"})


LINES = Exporter(
    name="lines",
    description="a line of JSON for each episode",
    write=write_lines,
    parameters=LinesSettings,
    suffix=".jsonl",
)
IMAGES = Exporter(
    name="images", description="a file of raw pixels for each camera", write=write_images
)
