"""The layout of a tutorial's script: images named by their stamp, IMU and odometry in one file.

``rgb/{ns}.png``, ``depth/{ns}.png`` (16 bit, mm) and ``imu_odom.csv``, where empty cells are values
that a row has not. The script names images by the time of arrival; here it is the header's stamp.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from grasp_factory.apps.bag_import.bag_topics import BagTopic, TopicRole
from grasp_factory.apps.bag_import.import_layout import ImportLayout
from grasp_factory.apps.bag_import.series_file import SeriesFile
from grasp_factory.apps.bag_import.series_rows import IMU, ODOMETRY, Cell, imu_cells, pose_cells
from grasp_factory.core.text_format import escaped
from grasp_factory.errors import UsageError
from grasp_factory.writers.exporters.images import write_png

_COLUMNS = "timestamp,topic,ax,ay,az,wx,wy,wz,pos_x,pos_y,pos_z,ori_x,ori_y,ori_z,ori_w".split(",")
_FOLDERS = {TopicRole.COLOUR: "rgb", TopicRole.DEPTH: "depth"}


class ArticleLayout(ImportLayout):
    """Has one colour topic, one depth topic, and any number of IMUs and odometries."""

    def __init__(self, folder: Path, topics: Sequence[BagTopic]) -> None:
        """Create the files.

        Raises:
            UsageError: for several colour topics, or several depth topics.
        """
        self.left_out = {
            topic.name: f"{topic.kind} has no place in the layout"
            for topic in topics
            if topic.role not in _FOLDERS and topic.kind not in (IMU, ODOMETRY)
        }
        for role in _FOLDERS:
            names = [topic.name for topic in topics if topic.role is role]
            if len(names) > 1:
                raise UsageError(
                    f"the layout has one topic of {role.value} images, got {', '.join(names)}:"
                    " choose with --topics"
                )
        self._folder = folder
        self._names: Counter[tuple[TopicRole, int]] = Counter()
        for name in {_FOLDERS[topic.role] for topic in topics if topic.role in _FOLDERS}:
            (folder / name).mkdir()
        has_series = any(topic.kind in (IMU, ODOMETRY) for topic in topics)
        self._series = SeriesFile(folder / "imu_odom.csv", _COLUMNS) if has_series else None

    def add(self, topic: BagTopic, stamp_ns: int, message: Any) -> None:
        """See ``ImportLayout.add``."""
        if topic.role in _FOLDERS:
            image = topic.image(message)
            path = self._folder / _FOLDERS[topic.role] / self._free_name(topic.role, stamp_ns)
            write_png(path, image.values)
        elif self._series:
            start: list[Cell] = [stamp_ns, escaped(topic.name)]
            empty: list[Cell] = [None]
            if topic.kind == IMU:
                self._series.add(stamp_ns, [*start, *imu_cells(message), *empty * 7])
            else:
                self._series.add(stamp_ns, [*start, *empty * 6, *pose_cells(message.pose.pose)])

    def _free_name(self, role: TopicRole, stamp_ns: int) -> str:
        """Return a name by the stamp; a second image of the same stamp gets _1, and so on."""
        same = self._names[role, stamp_ns]
        self._names[role, stamp_ns] += 1
        return f"{stamp_ns}_{same}.png" if same else f"{stamp_ns}.png"

    def finish(self) -> None:
        """See ``ImportLayout.finish``."""
        if self._series:
            self._series.finish()

    def close(self) -> None:
        """See ``ImportLayout.close``."""
        if self._series:
            self._series.close()
