from __future__ import annotations

import dataclasses
import math
import re

import numpy as np
import pytest

from grasp_factory.core import schema
from grasp_factory.core.config.cameras import CameraConfig
from grasp_factory.core.config.factory_config import FactoryConfig
from grasp_factory.core.config.scene import ClutterConfig
from grasp_factory.core.enums import Label, Outcome, Phase, names
from grasp_factory.core.episode import CameraFrames
from grasp_factory.core.schema import FIELDS, Field, expand, markdown_table, shape, sizes
from grasp_factory.core.sensors import series_groups
from grasp_factory.labels.rule import Measurements

CAMERAS = {
    "front": CameraConfig(eye=(1.1, 0.0, 0.6), target=(0.5, 0.0, 0.1)),
    "wrist_2": CameraConfig(eye=(0.5, 0.7, 0.5), target=(0.5, 0.0, 0.1)),
}
CONFIG = FactoryConfig(cameras=CAMERAS, resolution=(64, 48), record_hz=60, video_hz=10)
SIZES = sizes(CONFIG, joints=6)
IDS = [row.path for row in FIELDS]


class TestFields:
    def test_every_path_is_unique(self) -> None:
        assert len(set(IDS)) == len(IDS)

    @pytest.mark.parametrize("row", FIELDS, ids=IDS)
    def test_every_row_is_complete_and_readable(self, row: Field) -> None:
        assert re.fullmatch(
            r"(episodes|streams|imu|videos|force_torque|joints|taxels|(cameras|videos)/\{camera\})/\w+",
            row.path,
        )
        assert row.description
        if row.dtype != "string":
            assert np.dtype(row.dtype).name == row.dtype

    @pytest.mark.parametrize("row", FIELDS, ids=IDS)
    def test_every_coded_row_has_names_and_only_those(self, row: Field) -> None:
        is_coded = row.dtype == "uint8" and not row.path.endswith(("/rgb", "/quality"))
        assert bool(row.names) == is_coded
        assert len(set(row.names)) == len(row.names)

    @pytest.mark.parametrize("row", FIELDS, ids=IDS)
    def test_what_is_empty_is_no_value(self, row: Field) -> None:
        if row.dtype == "string":
            assert row.fill == ""
        elif np.dtype(row.dtype).kind == "f":
            assert math.isnan(row.fill)
        else:
            assert np.array(row.fill, row.dtype) == row.fill
            if row.names:
                first = row.names[0] in ("missing", "background")
                assert row.fill == 0 if first else row.fill >= len(row.names)

    def test_only_streams_have_a_time(self) -> None:
        for row in FIELDS:
            first = str(row.dims[0]) if row.dims else ""
            expected = {group.dim: group.length_column for group in series_groups()}.get(first, "")
            assert row.length_column == expected
            assert "T" not in row.dims[1:]

    def test_images_are_the_rows_with_pixels(self) -> None:
        images = {row.path.split("/")[-1] for row in FIELDS if row.is_image}
        assert images == {"rgb", "depth", "segmentation"}

    def test_every_measurement_has_a_column(self) -> None:
        columns = {f"episodes/{f.name}" for f in dataclasses.fields(Measurements)}
        assert columns <= set(IDS)

    def test_every_part_of_a_cameras_record_has_a_row_and_the_other_way_round(self) -> None:
        rows = [path.split("/")[-1] for path in IDS if path.startswith("cameras/")]
        assert rows == [f.name for f in dataclasses.fields(CameraFrames)]

    def test_frames_are_given_for_what_has_a_place_or_direction(self) -> None:
        for row in FIELDS:
            if re.search(r"_pose$|position$|quat|wrench|tactile_(force|normal)|T_world", row.path):
                assert row.frame, row.path


class TestExpand:
    def test_every_camera_has_every_camera_row_and_the_rest_is_there_once(self) -> None:
        paths = [row.path for row in expand(CONFIG)]
        simulated = [row.path for row in FIELDS if not row.is_real]
        per_camera = [path for path in simulated if "{camera}" in path]
        expected = [path for path in simulated if "{camera}" not in path]
        for camera in CAMERAS:
            expected += [path.format(camera=camera) for path in per_camera]
        assert sorted(paths) == sorted(expected)

    def test_without_video_there_are_no_video_rows(self) -> None:
        paths = [row.path for row in expand(dataclasses.replace(CONFIG, video_hz=0))]
        assert [path for path in paths if "video" in path] == []
        assert len(paths) == len(expand(CONFIG)) - 2 - 2 * len(CAMERAS)

    def test_labels_name_as_many_objects_as_fall(self) -> None:
        rows = expand(dataclasses.replace(CONFIG, clutter=ClutterConfig(count=3)))
        named = [row for row in rows if row.names[:1] == ("background",)]
        assert len(named) == 2 + len(CAMERAS)
        for row in named:
            assert row.names[5:] == ("target", "object_1", "object_2")

    def test_only_the_path_changes(self) -> None:
        by_path = {row.path: row for row in FIELDS}
        for row in expand(CONFIG):
            template = row.path.replace("/wrist_2/", "/{camera}/").replace("/front/", "/{camera}/")
            assert dataclasses.replace(row, path=template) == by_path[template]

    @pytest.mark.parametrize("row", expand(CONFIG), ids=lambda row: row.path)
    def test_every_dimension_has_a_size(self, row: Field) -> None:
        dims = shape(row, SIZES)
        assert len(dims) == len(row.dims)
        assert all(type(dim) is int and dim > 0 for dim in dims)


class TestSizes:
    def test_images_are_height_by_width(self) -> None:
        rows = {row.path: shape(row, SIZES) for row in expand(CONFIG)}
        assert rows["cameras/front/rgb"] == (2, 48, 64, 3)
        assert rows["cameras/front/depth"] == (2, 48, 64)

    def test_joints_and_contacts_are_counted(self) -> None:
        rows = {row.path: shape(row, SIZES)[1:] for row in expand(CONFIG)}
        assert rows["streams/joint_positions"] == (6,)
        assert rows["streams/tactile_force"] == (2, schema.MAX_CONTACTS, 3)
        assert rows["streams/object_pose"] == (1, 7)

    @pytest.mark.parametrize("record_hz", [10, 60, 120, 240])
    def test_the_streams_have_room_for_the_longest_attempt(self, record_hz: int) -> None:
        config = FactoryConfig(record_hz=record_hz)
        assert sizes(config, joints=7)["T"] == config.longest_attempt


class TestMarkdown:
    def test_every_row_of_the_table_is_a_row_of_the_markdown(self) -> None:
        header, rule, *rows = markdown_table().splitlines()
        assert header.count("|") == rule.count("|") == 6
        assert [row.split("`")[1] for row in rows] == IDS
        assert {row.count("|") for row in rows} == {6}

    def test_a_row_tells_shape_type_unit_frame_and_meaning(self) -> None:
        rows = markdown_table().splitlines()
        expected = "| `episodes/object_com` | (N, M, 3) | float64 | m | centre of mass [object] |"
        assert expected in rows


class TestCodes:
    """The values are stored, so they stay; new words are appended."""

    def test_outcomes_keep_their_values(self) -> None:
        assert names(Outcome)[:9] == [
            "success", "never_settled", "left_workspace", "no_plan", "unreachable",
            "collision", "no_contact", "lost_in_lift", "lost_in_hold",
        ]  # fmt: skip

    def test_phases_keep_their_values(self) -> None:
        assert names(Phase)[:5] == ["pregrasp", "approach", "close", "lift", "hold"]

    def test_labels_keep_their_values(self) -> None:
        expected = ["background", "floor", "table", "arm", "gripper", "target"]
        assert names(Label)[:6] == expected

    def test_status_keeps_its_values(self) -> None:
        assert schema.STATUS.names[:3] == ("missing", "committed", "quarantined")

    @pytest.mark.parametrize("words", [Outcome, Phase, Label])
    def test_a_words_position_is_its_value(
        self, words: type[Outcome] | type[Phase] | type[Label]
    ) -> None:
        assert [names(words)[word].upper() for word in words] == [word.name for word in words]
        assert [word == str(word) for word in words] == [True] * len(words)
        assert {word: k for k, word in enumerate(words)} == {int(word): int(word) for word in words}
        assert words(0) != str(words(1))
        assert names(words) == list(dict.fromkeys(names(words)))
