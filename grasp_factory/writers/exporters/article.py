"""The layout of a short tutorial script: images as PNG and .npy, one label file per episode.

``rgb/before_{i}.png``, ``depth/depth_before_{i}.npy`` (metres), ``seg/seg_before_{i}.npy``, the
same with ``after``, and ``label_{i}.npy``. The script pickles a dict as label. This export writes a
structured array instead, which loads without pickle: ``np.load(file)["success"]``.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from grasp_factory.core.episode import Episode
from grasp_factory.errors import lookup
from grasp_factory.writers.exporters.base import (
    REAL_SERIES,
    ExportContents,
    Exporter,
    ExportFolder,
    ExportJob,
    ExportPart,
)
from grasp_factory.writers.exporters.images import camera_of, read_png, write_png
from grasp_factory.writers.exporters.npy_file import read_npy
from grasp_factory.writers.exporters.selection import Selection

TIMES = ("before", "after")
"""Names of an episode's frames 0 and 1."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ArticleSettings:
    """Settings of the format."""

    camera: str = ""
    """The camera whose images are written; empty for the first one."""


def excludes(episodes: Selection, settings: ArticleSettings) -> Mapping[str, NDArray[np.bool_]]:
    """Check the camera; no episode is excluded.

    Raises:
        UnknownNameError: for an unknown camera.
    """
    camera_of(episodes, settings.camera)
    return {}


def write_part(job: ExportJob, part: ExportPart) -> None:
    """Write the files of some episodes."""
    camera = camera_of(job.episodes, job.settings.camera)
    rgb, depth, seg = (job.folder / name for name in ("rgb", "depth", "seg"))
    for folder in (rgb, depth, seg):
        folder.mkdir(exist_ok=True)
    for i, episode in part.episodes:
        frames = episode.cameras[camera]
        for k, time in enumerate(TIMES):
            write_png(rgb / f"{time}_{i}.png", frames.rgb[k])
            np.save(depth / f"depth_{time}_{i}.npy", frames.depth[k])
            np.save(seg / f"seg_{time}_{i}.npy", frames.segmentation[k])
        np.save(job.folder / f"label_{i}.npy", label(i, episode), allow_pickle=False)


def label(i: int, episode: Episode) -> NDArray[Any]:
    """Return the label of an episode: a structured array without dimensions."""
    columns = episode.columns
    name = str(columns["object_id"])
    fields = [
        ("index", np.int64),
        ("success", np.bool_),
        ("grasp_position", np.float64, (3,)),
        ("grasp_orientation", np.float64, (4,)),
        ("object_id", f"U{max(1, len(name))}"),
    ]
    values = (i, episode.success, columns["grasp_position"], columns["grasp_quat_xyzw"], name)
    return np.array(values, np.dtype(fields))


def read_back(folder: ExportFolder, i: int) -> dict[str, NDArray[Any]]:
    """Return the images of an episode by path; see ``Exporter.read_back``."""
    camera = folder.settings.camera or next(iter(folder.config.cameras))
    lookup(folder.config.cameras, "camera", camera)
    width, height = folder.config.resolution
    place = folder.place
    rgb = [read_png(place / f"rgb/{time}_{i}.png", (height, width, 3), "uint8") for time in TIMES]
    depth = [read_npy(place / f"depth/depth_{time}_{i}.npy") for time in TIMES]
    seg = [read_npy(place / f"seg/seg_{time}_{i}.npy") for time in TIMES]
    return {
        f"cameras/{camera}/rgb": np.stack(rgb),
        f"cameras/{camera}/depth": np.stack(depth),
        f"cameras/{camera}/segmentation": np.stack(seg),
    }


ARTICLE = Exporter(
    name="article",
    description="PNG and .npy files before and after the grasp, and a label file per episode",
    contents=ExportContents(
        written=("cameras/*/rgb", "cameras/*/depth", "cameras/*/segmentation"),
        left_out={
            "cameras/*": "the layout has one camera: see the option camera",
            "streams/*": "the layout has no time series",
            **dict.fromkeys(("imu/*", *REAL_SERIES), "the layout has no time series"),
            "videos/*": "the layout has no videos",
        },
        treatment={
            "no grasp": "grasp_position and grasp_orientation are NaN",
            "pickle": "label_{i}.npy is a structured array, not a pickled dict; it answers"
            ' np.load(file)["success"], and .item() returns a tuple',
        },
    ),
    excludes=excludes,
    write_part=write_part,
    series=(),
    read_back=read_back,
    parameters=ArticleSettings,
)
