"""The images of one camera in the layout ``sequences``, and what describes them."""

from __future__ import annotations

import json
from array import array
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from grasp_factory.apps.bag_import.bag_topics import BagTopic
from grasp_factory.apps.bag_import.camera_pairing import CameraTopics
from grasp_factory.apps.bag_import.image_folder import ImageFolder
from grasp_factory.apps.bag_import.series_file import SeriesFile
from grasp_factory.apps.bag_import.series_rows import Seconds, imu_cells
from grasp_factory.writers.exporters.json_file import finite, write_json

SLOP_NS = 100_000_000
"""Largest distance in time of images, or of an image and an IMU sample, that belong together.

0.1 s, the slop of a tutorial's approximate-time synchronizer.
"""


class ImuTrack:
    """The samples of an IMU in memory, to find the one nearest to a frame."""

    def __init__(self) -> None:
        self._stamps, self._values = array("q"), array("d")

    def add(self, stamp_ns: int, message: Any) -> None:
        """Append a sample."""
        cells = imu_cells(message)
        self._stamps.append(stamp_ns)
        self._values.extend(np.nan if cell is None else cell for cell in cells)

    def nearest(self, stamps: NDArray[np.int64]) -> list[dict[str, Any] | None]:
        """Return the sample nearest to each stamp (ns); None if none is within ``SLOP_NS``."""
        times = np.array(self._stamps, np.int64)
        order = np.argsort(times, kind="stable")
        values = np.array(self._values, np.float64).reshape(-1, 6)[order]
        times = times[order]
        return [
            None
            if k is None
            else {
                "timestamp": times[k] / 1e9,
                "angular_velocity": values[k, 3:].tolist(),
                "linear_acceleration": values[k, :3].tolist(),
            }
            for k in nearest(times, stamps)
        ]


class CameraSequence:
    """One camera's folder."""

    def __init__(self, folder: Path, camera: CameraTopics) -> None:
        """Create the folder."""
        folder.mkdir(parents=True)
        self.folder = folder
        self._camera = camera
        self._calibration: dict[str, dict[str, Any]] = {}
        self._colour = ImageFolder(folder / "rgb") if camera.colour else None
        self._depth = ImageFolder(folder / "depth") if camera.depth else None

    def has(self, topic: BagTopic) -> bool:
        """Return whether the topic belongs to this camera."""
        camera = self._camera
        return topic in (camera.colour, camera.depth, camera.colour_info, camera.depth_info)

    def add(self, topic: BagTopic, stamp_ns: int, content: Any) -> None:
        """Write an image; of calibrations the first one counts."""
        if topic == self._camera.colour and self._colour:
            self._colour.add(stamp_ns, content)
        elif topic == self._camera.depth and self._depth:
            self._depth.add(stamp_ns, content)
        else:
            self._calibration.setdefault(topic.name, content)

    def finish(self, imu: ImuTrack | None) -> None:
        """Write calibration and metadata."""
        nothing = np.empty(0, np.int64)
        colour = self._colour.finish() if self._colour else nothing
        depth = self._depth.finish() if self._depth else nothing
        infos = (self._camera.colour_info, self._camera.depth_info)
        found = [self._calibration.get(info.name) if info else None for info in infos]
        for name, calibration in zip(("cam", "depth"), found, strict=True):
            if calibration:
                (self.folder / "calibration").mkdir(exist_ok=True)
                write_json(self.folder / "calibration" / f"{name}_intrinsics.json", calibration)
        if self._depth:
            self._write_depth_times(depth)
        rows = list(self._frames(colour, depth))
        _write_rows(
            self.folder / "metadata.json",
            (row | {"camera_info": found[0] or found[1]} for row in rows),
        )
        if imu:
            samples = imu.nearest(colour if self._colour else depth)
            both = zip(rows, samples, strict=True)
            _write_rows(self.folder / "sync_metadata.json", (row | {"imu": s} for row, s in both))

    def _write_depth_times(self, stamps: NDArray[np.int64]) -> None:
        file = SeriesFile(self.folder / "depth" / "data.csv", ("timestamp", "file"))
        for k, stamp in enumerate(stamps.tolist()):
            file.add(stamp, [Seconds(stamp), f"{k:06d}.png"])
        file.finish()

    def _frames(
        self, colour: NDArray[np.int64], depth: NDArray[np.int64]
    ) -> Iterator[dict[str, Any]]:
        """Yield the entry of each colour image, or without colour of each depth image."""
        stamps = colour if self._colour else depth
        for k, (stamp, near) in enumerate(
            zip(stamps.tolist(), nearest(depth, stamps), strict=True)
        ):
            yield {
                "frame_id": k,
                "timestamp": stamp / 1e9,
                "timestamp_ns": stamp,
                "rgb_path": self._colour.path(k) if self._colour else "",
                "depth_path": "" if near is None or not self._depth else self._depth.path(near),
                "depth_timestamp_ns": None if near is None else int(depth[near]),
            }


def calibration_of(message: Any) -> dict[str, Any]:
    """Return size (pixels), K and distortion of a sensor_msgs/CameraInfo; ROS 1 has capitals."""
    K, D, R, P = (
        getattr(message, name.lower() if hasattr(message, "k") else name) for name in "KDRP"
    )
    return {
        "width": int(message.width),
        "height": int(message.height),
        "K": K.tolist(),
        "D": D.tolist(),
        "distortion_model": message.distortion_model,
        "R": R.tolist(),
        "P": P.tolist(),
    }


def nearest(times: NDArray[np.int64], at: NDArray[np.int64]) -> list[int | None]:
    """Return for each instant the position of the nearest time; None beyond ``SLOP_NS``.

    Args:
        times: (n,) ns, ascending.
        at: (m,) ns.
    """
    if not len(times):
        return [None] * len(at)
    after = np.clip(np.searchsorted(times, at), 0, len(times) - 1)
    before = np.maximum(after - 1, 0)
    near = np.where(np.abs(at - times[before]) <= np.abs(times[after] - at), before, after)
    is_near = np.abs(times[near] - at) <= SLOP_NS
    return [k if ok else None for k, ok in zip(near.tolist(), is_near.tolist(), strict=True)]


def _write_rows(path: Path, rows: Iterable[dict[str, Any]]) -> None:
    """Write a JSON list, a row in each line."""
    with path.open("x", encoding="utf-8") as file:
        file.write("[")
        for k, row in enumerate(rows):
            file.write(f"{',' if k else ''}\n{json.dumps(finite(row), allow_nan=False)}")
        file.write("\n]\n")
