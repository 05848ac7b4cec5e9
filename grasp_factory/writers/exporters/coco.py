"""COCO: instance masks of the images before and after each attempt, with the grasp as key points.

``images/{split}/{id:012d}.png``, and ``annotations/instances_{split}.json`` for each split of the
target object. Definition: https://cocodataset.org/#format-data
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from grasp_factory.core.enums import Label, label_names
from grasp_factory.core.episode import CameraFrames, Episode
from grasp_factory.core.splits import SPLITS
from grasp_factory.writers.exporters.base import (
    REAL_SERIES,
    ExportContents,
    Exporter,
    ExportJob,
    ExportPart,
)
from grasp_factory.writers.exporters.grasp_key_points import (
    KEY_POINTS,
    NOT_LABELLED,
    SKELETON,
    key_points,
)
from grasp_factory.writers.exporters.images import write_png
from grasp_factory.writers.exporters.json_items import (
    item,
    joined_items,
    keep_items,
    member,
    write_items,
)
from grasp_factory.writers.exporters.object_views import TIMES, box_of, of_no_split
from grasp_factory.writers.exporters.plain_columns import plain
from grasp_factory.writers.exporters.run_length import run_length
from grasp_factory.writers.exporters.selection import Selection

OBJECT, ROBOT = "object", "robot"
"""Supercategories."""
ROBOT_PARTS = {Label.ARM: "arm", Label.GRIPPER: "gripper"}
_LABELS = 256
"""Annotations of an image have numbers below it."""

Category = tuple[str, str]
"""Supercategory and name."""


def prepare(episodes: Selection, settings: Any) -> dict[Category, int]:
    """Return the ids of the categories, from 1: the robot's parts, then families of objects."""
    recipes = (recipe for spec in episodes.specs() for recipe in spec.objects)
    families = sorted({(OBJECT, recipe.family) for recipe in recipes})
    names = [*((ROBOT, name) for name in ROBOT_PARTS.values()), *families]
    return {name: k for k, name in enumerate(names, start=1)}


def write_part(job: ExportJob, part: ExportPart) -> None:
    """Write the images of some episodes, and keep their entries in the annotation files."""
    images: dict[str, list[str]] = {}
    annotations: dict[str, list[str]] = {}
    for place, episode in part.episodes:
        split = str(episode.columns["split"])
        folder = job.folder / "images" / split
        folder.mkdir(parents=True, exist_ok=True)
        for number, (camera, k) in enumerate(views(episode)):
            image_id = place * len(TIMES) * len(episode.cameras) + number + 1
            frames = episode.cameras[camera]
            write_png(folder / file_name(image_id), frames.rgb[k])
            entry = image_row(image_id, place, episode, camera, k)
            images.setdefault(split, []).append(item(entry))
            found = annotation_rows(image_id, episode, frames, k, job.prepared)
            annotations.setdefault(split, []).extend(map(item, found))
    for split, rows in images.items():
        keep_items(job, part, f"images-{split}", rows)
        keep_items(job, part, f"annotations-{split}", annotations[split])


def views(episode: Episode) -> Iterator[tuple[str, int]]:
    """Yield the camera and the frame of each image of an episode."""
    return ((camera, k) for camera in episode.cameras for k in range(len(TIMES)))


def file_name(image_id: int) -> str:
    """Return the name of an image's file."""
    return f"{image_id:012d}.png"


def image_row(image_id: int, place: int, episode: Episode, camera: str, k: int) -> dict[str, Any]:
    """Return the entry of an image: COCO's keys, and which image of which episode it is."""
    frames = episode.cameras[camera]
    height, width = frames.rgb.shape[1:3]
    return {
        "id": image_id,
        "file_name": file_name(image_id),
        "width": width,
        "height": height,
        "episode": place,
        "camera": camera,
        "time": TIMES[k],
        "K": plain(frames.intrinsics),
        "T_world_camera": plain(frames.T_world_camera[k]),
        "success": episode.success,
        "outcome": episode.outcome.name.lower(),
    }


def annotation_rows(
    image_id: int, episode: Episode, frames: CameraFrames, k: int, ids: Mapping[Category, int]
) -> Iterator[dict[str, Any]]:
    """Yield the annotation of each part of the robot and each object with a visible pixel."""
    objects = episode.spec.objects
    for label, name in enumerate(label_names(len(objects))):
        mask = frames.segmentation[k] == label
        if label < Label.ARM or not mask.any():
            continue
        row = {
            "id": image_id * _LABELS + label,
            "image_id": image_id,
            "iscrowd": 0,
            "area": int(np.count_nonzero(mask)),
            "bbox": box_of(mask),
            "segmentation": run_length(mask),
        }
        if label in ROBOT_PARTS:
            yield row | {"category_id": ids[ROBOT, name], "attributes": {"label": name}}
            continue
        m = label - Label.TARGET
        is_aim = m == 0 and k == 0
        points = key_points(episode, frames) if is_aim else [0.0] * 3 * len(KEY_POINTS)
        yield row | {
            "category_id": ids[OBJECT, objects[m].family],
            "keypoints": points,
            "num_keypoints": sum(v != NOT_LABELLED for v in points[2::3]),
            "attributes": {
                "label": name,
                "object_id": objects[m].object_id,
                "object_set": objects[m].object_set,
                "visibility": float(frames.visibility[k, m]),
                **({"success": episode.success} if m == 0 else {}),
            },
        }


def finish(job: ExportJob, parts: Sequence[None]) -> None:
    """Write the annotation file of each split that has images."""
    folder = job.folder / "annotations"
    folder.mkdir()
    rows = [category_row(name, number) for name, number in job.prepared.items()]
    about = {"description": "grasp-factory: images before and after grasps", "version": "1"}
    opening = ",\n".join(
        member(key, data) for key, data in (("info", about), ("licenses", []), ("categories", rows))
    )
    for split in SPLITS:
        if (job.folder / "images" / split).is_dir():
            write_items(
                folder / f"instances_{split}.json",
                "{" + opening + ",",
                joined_lists(job, split),
                "}",
            )


def joined_lists(job: ExportJob, split: str) -> Iterator[str]:
    """Yield the text of both long lists of a split's file."""
    yield '"images": [\n'
    yield from joined_items(job, f"images-{split}")
    yield '\n],\n"annotations": [\n'
    yield from joined_items(job, f"annotations-{split}")
    yield "\n]"


def category_row(category: Category, number: int) -> dict[str, Any]:
    """Return the entry of a category; objects have key points."""
    supercategory, name = category
    row = {"id": number, "name": name, "supercategory": supercategory}
    if supercategory == ROBOT:
        return row
    return row | {"keypoints": KEY_POINTS, "skeleton": SKELETON}


COCO = Exporter(
    name="coco",
    description="COCO: instance masks, boxes and the grasp as key points, before and after",
    contents=ExportContents(
        written=(
            "cameras/*/rgb",
            "cameras/*/segmentation",
            "cameras/*/intrinsics",
            "cameras/*/T_world_camera",
            "cameras/*/visibility",
        ),
        left_out={
            "cameras/*/depth": "the format has colour images; depth says which key points are"
            " hidden",
            "streams/*": "the format has no time series",
            **dict.fromkeys(("imu/*", *REAL_SERIES), "the format has no time series"),
            "videos/*": "its images are those before and after the attempt",
        },
        treatment={
            "NaN": "null",
            "no grasp": "the key points are not labelled (0), and num_keypoints is 0",
            "after the attempt": "the key points are not labelled: the grasp is that of the scene"
            " before",
            "grasp": "grasp_center is the TCP, finger_minus_y and finger_plus_y are the ends of the"
            " opening; hidden (1) where the depth image has something nearer, else visible (2)",
            "floor, table, background": "no instances; all pixels without a mask are these",
            "an object without a visible pixel": "it has no annotation in this image",
            "split": "an episode is in the split of its target; other objects of the scene may be"
            " of another split",
        },
    ),
    excludes=of_no_split,
    prepare=prepare,
    write_part=write_part,
    series=(),
    finish=finish,
)
