"""Reading episodes of the format ``sequences`` back."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from grasp_factory.core import schema
from grasp_factory.core.json_text import parsed
from grasp_factory.core.limits import DOCUMENT
from grasp_factory.core.place import Place
from grasp_factory.writers.exporters.base import ExportFolder
from grasp_factory.writers.exporters.images import read_png
from grasp_factory.writers.exporters.sequence_tables import MM, read_table, tables


def read_back(folder: ExportFolder, place: int) -> dict[str, NDArray[Any]]:
    """Return the arrays of an episode by path; see ``Exporter.read_back``."""
    config = folder.config
    first = folder.place / f"sequences/{place:06d}_{next(iter(config.cameras))}"
    size = schema.sizes(config, folder.joints)
    found: dict[str, NDArray[Any]] = {}
    taxels = (size.get("X", 0), size.get("Y", 0))
    for name, table in tables(folder.joints, config.clutter.count, taxels).items():
        if any(path in folder.fields for path in table.values()):
            found |= read_table(first / name / "data.csv", table, folder.fields, size)
    for camera in config.cameras:
        found |= _images_back(folder, folder.place / f"sequences/{place:06d}_{camera}", camera)
    return found


def _images_back(folder: ExportFolder, sequence: Place, camera: str) -> dict[str, NDArray[Any]]:
    """Return the images of a camera, its poses in the videos and their clock."""
    width, height = folder.config.resolution
    frames = parsed((sequence / "metadata.json").read_bytes(DOCUMENT))
    videos = [frame for frame in frames if frame["what"] == "video"]

    def images(kind: str, numbers: Sequence[int], dtype: str) -> NDArray[Any]:
        shape = (height, width, 3) if kind == "rgb" else (height, width)
        files = [sequence / kind / f"{k:06d}.png" for k in numbers]
        read = [read_png(file, shape, dtype) for file in files]
        return np.stack(read) if read else np.empty((0, *shape), dtype)

    ends, at = (0, len(frames) - 1), f"cameras/{camera}"
    found = {
        f"{at}/rgb": images("rgb", ends, "uint8"),
        f"{at}/depth": (images("depth", ends, "uint16") * MM).astype(np.float32),
        f"{at}/segmentation": images("segmentation", ends, "uint8"),
    }
    if not folder.config.video_hz:
        return found
    poses = np.array([frame["T_world_camera"] for frame in videos], np.float64)
    return found | {
        f"videos/{camera}/rgb": images("rgb", range(1, len(frames) - 1), "uint8"),
        f"videos/{camera}/T_world_camera": poses.reshape(len(videos), 4, 4),
        "videos/timestamp": np.array([frame["timestamp"] for frame in videos], np.float64),
    }
