"""Image sequences with CSV files: what a bag has of the export format ``sequences``.

``sequences/{00}/`` for each camera: ``rgb/``, ``depth/`` (PNG, 16 bit, mm; ``data.csv`` says when),
``calibration/cam_intrinsics.json``, ``metadata.json`` (a list of frames), ``sync_metadata.json``
(each with the IMU's sample nearest to it), and ``data.csv`` in ``imu/``, ``odometry/``, ``joints/``
and ``force/``. ``dataset_info.yaml`` says which topic is where.
"""

from __future__ import annotations

import contextlib
import shutil
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import yaml

from grasp_factory.apps.bag_import.bag_topics import BagTopic, TopicRole
from grasp_factory.apps.bag_import.camera_pairing import CameraTopics, pair_cameras
from grasp_factory.apps.bag_import.camera_sequence import CameraSequence, ImuTrack, calibration_of
from grasp_factory.apps.bag_import.import_layout import ImportLayout
from grasp_factory.apps.bag_import.series_file import SeriesFile
from grasp_factory.apps.bag_import.series_rows import IMU, SERIES_KINDS, Seconds

_SERIES = "data.csv"
_UNITS = {
    "timestamp": "s, of the header, or of the arrival where the header has none",
    "depth": "mm, 0 for no value",
    "ax, ay, az": "m/s2",
    "wx, wy, wz": "rad/s",
    "px, py, pz": "m",
    "q": "quaternion x, y, z, w; empty cells: none was measured",
    "vx, vy, vz": "m/s",
    "fx, fy, fz": "N",
    "tx, ty, tz": "N m",
    "joint position, velocity, effort": "rad, rad/s and N m, or m, m/s and N",
}


class SequenceLayout(ImportLayout):
    """Has a sequence for each camera; each of them has all time series."""

    def __init__(self, folder: Path, topics: Sequence[BagTopic]) -> None:
        """Create the files."""
        self._folder = folder
        self._cameras = pair_cameras(topics) or [CameraTopics()]
        self._sequences = [
            CameraSequence(folder / "sequences" / f"{k:02d}", camera)
            for k, camera in enumerate(self._cameras)
        ]
        series = [topic for topic in topics if topic.role is TopicRole.SERIES]
        self._folders = series_folders(series)
        self._series: dict[str, SeriesFile] = {}
        with contextlib.ExitStack() as failed:
            failed.callback(self.close)
            for topic in series:
                self._series[topic.name] = self._series_file(topic)
            failed.pop_all()
        self._imu_topic = next((topic.name for topic in series if topic.kind == IMU), None)
        self._imu = ImuTrack()
        self.left_out = {
            topic.name: "no image topic is beside it"
            for topic in topics
            if topic.role is TopicRole.CAMERA_INFO
            and not any(sequence.has(topic) for sequence in self._sequences)
        }

    def _series_file(self, topic: BagTopic) -> SeriesFile:
        folder = self._sequences[0].folder / self._folders[topic.name]
        folder.mkdir()
        return SeriesFile(folder / _SERIES, ("timestamp", *SERIES_KINDS[topic.kind].columns))

    def add(self, topic: BagTopic, stamp_ns: int, message: Any) -> None:
        """See ``ImportLayout.add``."""
        if topic.role is TopicRole.SERIES:
            for row in SERIES_KINDS[topic.kind].rows(message):
                self._series[topic.name].add(stamp_ns, [Seconds(stamp_ns), *row])
            if topic.name == self._imu_topic:
                self._imu.add(stamp_ns, message)
            return
        is_info = topic.role is TopicRole.CAMERA_INFO
        content = calibration_of(message) if is_info else topic.image(message).values
        for sequence in self._sequences:
            if sequence.has(topic):
                sequence.add(topic, stamp_ns, content)

    def finish(self) -> None:
        """See ``ImportLayout.finish``."""
        for series in self._series.values():
            series.finish()
        first, *others = self._sequences
        for sequence in others:
            for name in self._folders.values():
                (sequence.folder / name).mkdir()
                shutil.copyfile(*(each.folder / name / _SERIES for each in (first, sequence)))
        for sequence in self._sequences:
            sequence.finish(self._imu if self._imu_topic else None)
        text = yaml.safe_dump(self._info(), sort_keys=False, allow_unicode=True)
        (self._folder / "dataset_info.yaml").write_text(text, encoding="utf-8")

    def close(self) -> None:
        """See ``ImportLayout.close``."""
        for series in self._series.values():
            series.close()

    def _info(self) -> dict[str, Any]:
        return {
            "description": "imported from a ROS bag",
            "sequences": {
                sequence.folder.name: {
                    name: topic.name
                    for name in ("colour", "depth", "colour_info", "depth_info")
                    if (topic := getattr(camera, name))
                }
                for camera, sequence in zip(self._cameras, self._sequences, strict=True)
            },
            "series": {folder: topic for topic, folder in self._folders.items()},
            "units": _UNITS,
        }


def series_folders(series: Sequence[BagTopic]) -> dict[str, str]:
    """Return the folder of each topic: the name of its kind, of further ones with _1, _2, ..."""
    folders: dict[str, str] = {}
    for topic in series:
        name = SERIES_KINDS[topic.kind].name
        same = sum(
            SERIES_KINDS[other.kind].name == name for other in series if other.name in folders
        )
        folders[topic.name] = f"{name}_{same}" if same else name
    return folders
