"""YCB-Video: colour, depth and label images, and MATLAB files with the poses, in metres.

A sequence is an episode: ``data/{sequence:04d}/{frame:06d}-color.png`` and so on, frames from 1:
before and after the attempt, for one camera after the other. A class is an object of one size. The
layout is that of https://rse-lab.cs.washington.edu/projects/posecnn/, as
https://github.com/j96w/DenseFusion reads it.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from grasp_factory.core.episode import ObjectSpec
from grasp_factory.core.splits import SPLITS
from grasp_factory.errors import UsageError
from grasp_factory.writers.exporters.base import (
    REAL_ROWS,
    REAL_SERIES,
    ExportContents,
    Exporter,
    ExportJob,
    ExportPart,
)
from grasp_factory.writers.exporters.mesh_files import obj_file_text, surface_points, xyz_text
from grasp_factory.writers.exporters.object_models import (
    ModelKey,
    NumberedModel,
    keep_model_rows,
    key_of,
    new_models,
    number_models,
    write_model_rows,
)
from grasp_factory.writers.exporters.object_views import (
    TIMES,
    ObjectView,
    of_no_split,
    of_real_objects,
)
from grasp_factory.writers.exporters.selection import Selection
from grasp_factory.writers.exporters.ycb_frame import write_frame

MOST_CLASSES = 255
"""A label image has 8 bits, and 0 is the background."""
POINTS = 2620
"""Points of ``points.xyz``: DenseFusion draws 2600 of them."""
LEAST_PIXELS = 51
"""An image is listed if an object has so many pixels: DenseFusion searches for one forever."""
TWICE = "an object is in the scene twice, and a label image does not tell both apart"
LONGEST_NAME = 40
"""Characters of a family in the name of a class."""

PartResult = tuple[dict[str, list[str]], list[str]]
"""Frames by split, and names of new classes."""


def excludes(episodes: Selection, settings: Any) -> dict[str, NDArray[np.bool_]]:
    """Exclude real episodes, those with two equal objects, and those of an unknown split."""
    ids = np.sort(np.array(episodes.column("object_ids").tolist()), axis=1)
    is_twice = (ids[:, 1:] == ids[:, :-1]).any(axis=1)
    return {**of_real_objects(episodes), TWICE: is_twice, **of_no_split(episodes, settings)}


def prepare(episodes: Selection, settings: Any) -> dict[ModelKey, NumberedModel]:
    """Return the numbers of all classes.

    Raises:
        UsageError: if there are too many.
    """
    numbers = number_models(episodes)
    if len(numbers) > MOST_CLASSES:
        raise UsageError(
            f"ycb: got {len(numbers)} different objects, valid: up to {MOST_CLASSES}, as a label"
            " image has 8 bits; choose fewer episodes or a smaller set of objects, or export to bop"
        )
    return numbers


def class_name(number: int, recipe: ObjectSpec) -> str:
    """Return the name of a class, such as ``007_mug``: only its number makes it unique."""
    plain = re.sub(r"[^a-z0-9]+", "_", recipe.family.lower())[:LONGEST_NAME].strip("_")
    return f"{number:03d}_{plain or 'object'}"


def write_part(job: ExportJob, part: ExportPart) -> PartResult:
    """Write the sequences of some episodes and their new models.

    Returns:
        The frames of each split that ``image_sets`` lists, and the names of the new classes.
    """

    def class_of(view: ObjectView) -> tuple[int, str]:
        number = job.prepared[key_of(view.recipe)].number
        return number, class_name(number, view.recipe)

    listed: dict[str, list[str]] = {split: [] for split in SPLITS}
    models: dict[int, tuple[ObjectSpec, str]] = {}
    for place, episode in part.episodes:
        folder = job.folder / "data" / f"{place:04d}"
        folder.mkdir(parents=True)
        for c, frames in enumerate(episode.cameras.values()):
            for k in range(len(TIMES)):
                stem = folder / f"{c * len(TIMES) + k + 1:06d}"
                if write_frame(stem, episode, frames, k, class_of) >= LEAST_PIXELS:
                    split = str(episode.columns["split"])
                    listed[split].append(f"{folder.name}/{stem.name}")
        for number, recipe in new_models(job.prepared, place, episode):
            models[number] = (recipe, write_model(job, place, number, recipe))
    keep_model_rows(job, part, models)
    return listed, [class_name(number, recipe) for number, (recipe, _) in models.items()]


def write_model(job: ExportJob, place: int, number: int, recipe: ObjectSpec) -> str:
    """Write a model's files, and return the name of the OBJ file in the export."""
    folder = f"models/{class_name(number, recipe)}"
    (job.folder / folder).mkdir(parents=True)
    mesh = job.episodes.object_mesh(place, recipe)
    (job.folder / folder / "textured.obj").write_text(obj_file_text(mesh), encoding="ascii")
    points = xyz_text(surface_points(mesh, POINTS))
    (job.folder / folder / "points.xyz").write_text(points, encoding="ascii")
    return f"{folder}/textured.obj"


def finish(job: ExportJob, parts: Sequence[PartResult]) -> None:
    """Write the lists of frames and classes."""
    lists = {split: [frame for listed, _ in parts for frame in listed[split]] for split in SPLITS}
    lists["classes"] = [name for _, names in parts for name in names]
    folder = job.folder / "image_sets"
    folder.mkdir()
    for name, lines in lists.items():
        text = "".join(f"{line}\n" for line in lines)
        (folder / f"{name}.txt").write_text(text, encoding="ascii")
    write_model_rows(job)


YCB = Exporter(
    name="ycb",
    description="YCB-Video: label images and MATLAB files with 6D poses, up to 255 objects",
    contents=ExportContents(
        written=(
            "cameras/*/rgb",
            "cameras/*/depth",
            "cameras/*/segmentation",
            "cameras/*/intrinsics",
            "cameras/*/T_world_camera",
        ),
        left_out={
            "streams/object_pose": "the format's series are images; the last record is the pose in"
            " the images after the attempt",
            "streams/*": "the format has images only",
            **dict.fromkeys(("imu/*", *REAL_SERIES), "the format has images only"),
            "videos/*": "its frames are those before and after the attempt, which have depth",
        },
        treatment={
            "depth": "16-bit PNG in units of 0.1 mm; 0 where the store has NaN or more than"
            " 6.5535 m",
            "labels": "numbers of classes; robot, table, floor and background are 0",
            "poses": "before the attempt those at rest; after it the last record, up to one period"
            " of the streams before the image; if the robot did not move, both are the same",
            "an object without a finite pose": "it is not in that frame's files",
            "models": "an object of another scale is another class; textured.obj has no texture,"
            f" points.xyz has {POINTS} points of the surface",
            "image_sets": f"a frame in which no object has {LEAST_PIXELS} pixels is not listed",
            "vertmap": "the files have no vertmap: it follows from depth and pose",
            "split": "an episode is in the split of its target; other objects of the scene may be"
            " of another split",
            REAL_ROWS: "left out: real objects have no models and no poses",
            "no grasp, no video": "the same as for other episodes",
        },
    ),
    excludes=excludes,
    prepare=prepare,
    write_part=write_part,
    series=("streams/object_pose",),
    finish=finish,
    libraries=("scipy",),
    extra="ycb",
)
