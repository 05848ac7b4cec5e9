"""The LeRobot format, read with pyarrow, OpenCV and PyAV by what its metadata says."""

from __future__ import annotations

import importlib.util
import json
import subprocess
import sys
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import av
import cv2
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from numpy.typing import NDArray
from support.exporter_contract import cameras, make_store
from support.fake_episodes import JOINTS, make_episode
from support.helpers import assert_same_tree
from support.lossy_video import assert_same_video
from support.stored import varied

from grasp_factory.dataset.dataset import Dataset
from grasp_factory.errors import ConfigError, UsageError
from grasp_factory.writers.exporters.lerobot.numbering import FILES_IN_CHUNK, new_file
from grasp_factory.writers.exporters.lerobot.statistics import moments_of
from grasp_factory.writers.zarr.store import prepare_store
from grasp_factory.writers.zarr.writer import ZarrWriter

WITH_FRAMES = (0, 1, 3, 5)
"""Rows of ``make_store`` whose robot moved."""
LEFT_OUT = ("rgb", "depth", "segmentation")
"""Images before and after the attempt."""


WINDOWS = (
    *("observation.joint_positions", "observation.joint_velocities", "observation.joint_torques"),
    *("observation.gripper_width", "observation.gripper_force", "observation.tcp_pose"),
    *("observation.tactile_wrench", "observation.wrist_wrench"),
    *("observation.imu.specific_force", "observation.imu.angular_velocity"),
)
NUMPY = {"min": np.nanmin, "max": np.nanmax, "mean": np.nanmean, "std": np.nanstd}


@dataclass
class LeRobotFolder:
    """Reads an export by its own metadata, with nothing of the package."""

    path: Path

    @cached_property
    def info(self) -> Any:
        return self._json("info.json")

    @cached_property
    def arrays(self) -> Any:
        return self._json("arrays.json")

    @cached_property
    def stats(self) -> Any:
        return self._json("stats.json")

    @cached_property
    def episodes(self) -> list[dict[str, Any]]:
        return self._table("meta/episodes").to_pylist()

    @cached_property
    def data(self) -> pa.Table:
        return self._table("data")

    @cached_property
    def extras(self) -> pa.Table:
        return self._table("extras")

    def rows(self, name: str, episode: int) -> list[Any]:
        """Return a column of an episode's frames."""
        row = self.episodes[episode]
        start, end = row["dataset_from_index"], row["dataset_to_index"]
        return list(self.data[name].slice(start, end - start).to_pylist())

    def feature(self, name: str, episode: int) -> NDArray[Any]:
        """Return the values of an episode's frames, (frames, *shape)."""
        facts = self.info["features"][name]
        rows = self.rows(name, episode)
        shape = [] if facts["shape"] == [1] else facts["shape"]
        values = np.array(rows, facts["dtype"])
        assert values.shape == (len(rows), *shape)
        return values

    def images(self, name: str, episode: int) -> NDArray[np.uint8]:
        """Return the RGB images of an episode's frames; those of a video by their time."""
        if self.info["features"][name]["dtype"] == "image":
            rows = self.rows(name, episode)
            encoded = [np.frombuffer(row["bytes"], np.uint8) for row in rows]
            return np.stack([cv2.imdecode(one, cv2.IMREAD_COLOR)[..., ::-1] for one in encoded])
        row = self.episodes[episode]
        numbers = {key: row[f"videos/{name}/{key}"] for key in ("chunk_index", "file_index")}
        path = self.path / self.info["video_path"].format(video_key=name, **numbers)
        start, end = (row[f"videos/{name}/{key}_timestamp"] for key in ("from", "to"))
        with av.open(str(path)) as video:
            shown = [frame for frame in video.decode(video=0) if start - 1e-4 < frame.time]
            images = [
                frame.to_ndarray(format="rgb24") for frame in shown if frame.time < end - 1e-4
            ]
        return np.stack(images)

    def series(self, path: str, episode: int) -> NDArray[Any]:
        """Return an array of the store: the windows of all frames, and what is after them."""
        facts = self.arrays[path]
        values = self.feature(facts["feature"], episode).astype(facts["dtype"])
        per_frame = facts["records_per_frame"]
        records = values.reshape(-1, *values.shape[2:]) if per_frame > 1 else values
        rest = np.array(self.extras[path][episode].as_py(), facts["dtype"])
        return np.concatenate([records, rest.reshape(-1, *records.shape[1:])])

    def constant(self, path: str, episode: int) -> NDArray[Any]:
        facts = self.arrays[path]
        return np.array(self.extras[facts["extras"]][episode].as_py(), facts["dtype"])

    def _json(self, name: str) -> Any:
        return json.loads((self.path / "meta" / name).read_text())

    def _table(self, folder: str) -> pa.Table:
        files = sorted((self.path / folder).glob("*/*.parquet"))
        return pa.concat_tables([pq.read_table(file) for file in files])


Export = Callable[..., LeRobotFolder]


@pytest.fixture
def export(tmp_path: Path) -> Export:
    def export(dataset: Dataset, rows: Any = None, **settings: Any) -> LeRobotFolder:
        path = tmp_path / f"out{len(list(tmp_path.iterdir()))}"
        dataset.export("lerobot", path, rows, **settings)
        return LeRobotFolder(path)

    return export


@pytest.fixture(scope="module")
def real() -> Dataset:
    return Dataset(varied())


@pytest.fixture(scope="module")
def fake(tmp_path_factory: pytest.TempPathFactory) -> Dataset:
    return make_store(tmp_path_factory.mktemp("fake") / "store.zarr")


def compare(folder: LeRobotFolder, dataset: Dataset, rows: Any, *, is_exact: bool) -> None:
    """Compare every array of the store with what the folder has."""
    for k, row in enumerate(rows):
        for path, values in dataset[row].contents().items():
            group, _, name = path.partition("/")
            if group == "episodes" or (group == "cameras" and path.endswith(LEFT_OUT)):
                continue
            if group == "videos" and path.endswith("/rgb"):
                found = folder.images(f"observation.images.{name.removesuffix('/rgb')}", k)
                if is_exact:
                    np.testing.assert_array_equal(found, values)
                else:
                    assert_same_video(found, values)
            elif group == "cameras" or name == "T_tcp_imu":
                np.testing.assert_array_equal(folder.constant(path, k), values)
            else:
                found = folder.series(path, k)
                assert found.dtype == values.dtype
                np.testing.assert_array_equal(found, values)


@pytest.mark.parametrize("video", ["mp4v", "av1", "image"])
def test_every_array_of_a_simulated_store_is_read_back(
    export: Export, real: Dataset, video: str
) -> None:
    folder = export(real, video=video)
    assert folder.info["total_episodes"] == len(folder.episodes) == len(real)
    compare(folder, real, range(len(real)), is_exact=video == "image")


def test_every_array_is_read_back_from_several_files_in_the_order_of_the_rows(
    export: Export, fake: Dataset
) -> None:
    rows = [row for row in WITH_FRAMES[::-1] if fake.value(row, "n_video")]
    assert len(rows) > 2
    folder = export(fake, rows, video="image", episodes_per_file=2)
    assert len(list((folder.path / "data/chunk-000").iterdir())) == (len(rows) + 1) // 2
    compare(folder, fake, rows, is_exact=True)
    index = folder.data["index"].to_pylist()
    assert index == list(range(folder.info["total_frames"]))


def test_records_after_the_last_frame_are_kept_aside(export: Export, real: Dataset) -> None:
    folder = export(real)
    per_frame = real.config.record_hz // real.config.video_hz
    extras = pq.read_table(folder.path / "extras/chunk-000/file-000.parquet")
    rest = [len(row) for row in extras["streams/reward"].to_pylist()]
    assert rest == [episode.n_steps % per_frame for episode in real]
    assert any(rest)


def test_a_frame_has_the_state_of_its_time_and_the_commands_of_the_next(
    export: Export, real: Dataset
) -> None:
    folder = export(real)
    for k, episode in enumerate(real):
        streams, times = episode.streams, episode.videos["timestamp"]
        at = [int(np.argmin(np.abs(streams["timestamp"] - time))) for time in times]
        later = [*at[1:], episode.n_steps - 1]
        state, action = (folder.feature(name, k) for name in ("observation.state", "action"))
        np.testing.assert_array_equal(state[:, :-1], streams["joint_positions"][at])
        np.testing.assert_array_equal(state[:, -1], streams["gripper_width"][at])
        np.testing.assert_array_equal(action[:, :-1], streams["joint_position_targets"][later])
        np.testing.assert_array_equal(action[:, -1], streams["gripper_width_target"][later])
        np.testing.assert_allclose(folder.feature("timestamp", k), times - times[0], atol=1e-6)


def test_policies_see_no_truth(export: Export, real: Dataset) -> None:
    """LeRobot's policies may take every feature whose name begins with observation or action."""
    folder = export(real)
    arrays = folder.arrays
    taken = {
        path
        for path, facts in arrays.items()
        if facts.get("feature", "").startswith(("observation", "action"))
    }
    assert taken == {
        *("streams/joint_positions", "streams/joint_velocities", "streams/joint_torques"),
        *("streams/gripper_width", "streams/gripper_force", "streams/tcp_pose"),
        *("streams/tactile_wrench", "streams/wrist_wrench"),
        *("imu/specific_force", "imu/angular_velocity"),
        *("videos/front/rgb", "videos/wrist/rgb"),
    }


def test_statistics_are_those_of_the_values(export: Export, fake: Dataset) -> None:
    rows = [row for row in WITH_FRAMES if fake.value(row, "n_video")]
    folder = export(fake, rows, video="image", episodes_per_file=2)
    stats = folder.stats
    for name, facts in folder.info["features"].items():
        is_image = facts["dtype"] == "image"
        if name not in stats:
            assert name.startswith(("truth.", "streams.", "imu.", "videos."))
            continue
        read = folder.images if is_image else folder.feature
        each = [read(name, k) for k in range(len(rows))]
        stored = [
            {key: row[f"stats/{name}/{key}"] for key in ("count", *NUMPY)}
            for row in folder.episodes
        ]
        sets = zip([*each, np.concatenate(each)], [*stored, stats[name]], strict=True)
        for values, found in sets:
            assert found["count"] == [len(values)]
            numbers = values / 255.0 if is_image else values.astype(float)
            axes = (0, 1, 2) if is_image else (0, 1) if name in WINDOWS else (0,)
            shape = (3, 1, 1) if is_image else tuple(facts["shape"])
            for key, function in NUMPY.items():
                wanted = function(numbers, axis=axes)
                wanted = wanted.reshape(shape) if is_image else np.broadcast_to(wanted, shape)
                assert np.shape(found[key]) == shape
                np.testing.assert_allclose(found[key], wanted, rtol=1e-9, atol=1e-9)


def test_statistics_without_a_value_are_0() -> None:
    values = np.full((4, 2), np.nan)
    values[:, 1] = [1.0, np.inf, np.nan, 3.0]
    found = moments_of(values).plain((2,))
    assert found == {
        "min": [0.0, 1.0],
        "max": [0.0, 3.0],
        "mean": [0.0, 2.0],
        "std": [0.0, 1.0],
        "count": [4],
    }


@pytest.mark.soak
def test_the_bytes_of_av1_do_not_depend_on_the_number_of_workers(
    fake: Dataset, tmp_path: Path
) -> None:
    for workers in (1, 2):
        out = tmp_path / str(workers)
        fake.export("lerobot", out, workers=workers, video="av1", episodes_per_file=2)
    assert_same_tree(tmp_path / "1", tmp_path / "2")


def test_the_text_of_a_task_is_the_index_of_a_pandas_table(export: Export, real: Dataset) -> None:
    folder = export(real)
    tasks = pq.read_table(folder.path / "meta/tasks.parquet").to_pandas()
    families = sorted({str(episode.columns["object_family"]) for episode in real})
    assert list(tasks.index) == [f"Grasp the {family} and lift it." for family in families]
    assert tasks["task_index"].tolist() == list(range(len(families)))
    for k, episode in enumerate(real):
        text = f"Grasp the {episode.columns['object_family']} and lift it."
        assert folder.episodes[k]["tasks"] == [text]
        assert set(folder.feature("task_index", k)) == {tasks["task_index"][text]}


def test_a_task_may_name_a_family_of_any_letters(export: Export, tmp_path: Path) -> None:
    config = make_store(tmp_path / "other.zarr").config
    families = ["../../é \N{GRINNING FACE}\n", "a_b", "a b"]
    prepare_store(tmp_path / "named.zarr", config, JOINTS, 3, {})
    rows = [make_episode(config, k, n_steps=8) for k in range(3)]
    named = [
        replace(row, columns={**row.columns, "object_family": family})
        for row, family in zip(rows, families, strict=True)
    ]
    ZarrWriter(tmp_path / "named.zarr").write_block(0, named)
    folder = export(Dataset(tmp_path / "named.zarr"))
    tasks = [row["tasks"][0] for row in folder.episodes]
    assert tasks[0] == f"Grasp the {families[0]} and lift it."
    assert tasks[1] == tasks[2] == "Grasp the a b and lift it."
    assert folder.info["total_tasks"] == 2


def test_other_formats_need_none_of_its_libraries() -> None:
    code = (
        "import sys; from grasp_factory.writers.exporters import EXPORTERS;"
        "sys.exit(bool({'pyarrow', 'av'} & set(sys.modules)))"
    )
    subprocess.run([sys.executable, "-c", code], check=True)


def test_an_episode_says_how_it_ended(export: Export, real: Dataset, fake: Dataset) -> None:
    outcomes = set()
    for dataset in (real, fake):
        folder = export(dataset)
        rows = [row for row in dataset.committed if dataset.value(row, "n_video")]
        for k, (row, facts) in enumerate(zip(rows, folder.episodes, strict=True)):
            success, columns = dataset[row].success, dataset[row].columns
            outcomes.add(success)
            assert (facts["success"], facts["split"]) == (success, columns["split"])
            assert facts["outcome"] == dataset[row].outcome.name.lower()
            before = [False] * (facts["length"] - 1)
            assert folder.feature("next.done", k).tolist() == [*before, True]
            assert folder.feature("next.success", k).tolist() == [*before, success]
            assert folder.feature("next.reward", k).tolist() == [*before, success]
    assert outcomes == {False, True}


def test_a_side_of_an_odd_length_is_a_pixel_longer_in_videos_alone(
    export: Export, tmp_path: Path
) -> None:
    dataset = make_store(tmp_path / "odd.zarr", resolution=(33, 25))
    row = next(row for row in dataset.committed if dataset.value(row, "n_video"))
    name = "observation.images.front"
    for video, size in (("mp4v", [26, 34, 3]), ("av1", [26, 34, 3]), ("image", [25, 33, 3])):
        folder = export(dataset, [row], video=video)
        assert folder.info["features"][name]["shape"] == size
        assert list(folder.images(name, 0).shape[1:]) == size
    np.testing.assert_array_equal(folder.images(name, 0), dataset[row].videos["front/rgb"])


def test_one_record_per_frame_is_no_window(export: Export, tmp_path: Path) -> None:
    dataset = make_store(tmp_path / "slow.zarr", video_hz=10)
    rows = [row for row in dataset.committed if dataset.value(row, "n_video")]
    folder = export(dataset, rows, video="image")
    assert folder.info["features"]["observation.gripper_width"]["shape"] == [1]
    compare(folder, dataset, rows, is_exact=True)


def test_a_camera_may_have_a_name_of_any_letters(export: Export, tmp_path: Path) -> None:
    name = "カメラ_é"
    dataset = make_store(tmp_path / "named.zarr", cameras={name: cameras("front")["front"]})
    row = next(row for row in dataset.committed if dataset.value(row, "n_video"))
    folder = export(dataset, [row])
    frames = dataset.value(row, "n_video")
    assert len(folder.images(f"observation.images.{name}", 0)) == frames


def test_an_episode_without_frames_is_left_out(fake: Dataset, tmp_path: Path) -> None:
    idle = [row for row in fake.committed if not fake.value(row, "n_video")]
    found = fake.export("lerobot", tmp_path / "out")
    assert sum(found.excluded.values()) == len(idle)
    assert found.episodes == len(fake.committed) - len(idle)


def test_an_episode_whose_series_end_before_its_last_frame_is_left_out(tmp_path: Path) -> None:
    whole = make_store(tmp_path / "whole.zarr")
    config, path = whole.config, tmp_path / "short.zarr"
    episode = make_episode(config, 0, n_steps=8)
    imu = {name: values[:3] for name, values in episode.imu.items() if name != "T_tcp_imu"}
    short = {**episode.own_rate, "imu": {**episode.imu, **imu}}
    prepare_store(path, config, JOINTS, 2, {})
    rows = [replace(episode, own_rate=short), make_episode(config, 1, n_steps=8)]
    ZarrWriter(path).write_block(0, rows)
    found = Dataset(path).export("lerobot", tmp_path / "out")
    assert (found.episodes, list(found.excluded.values())) == (1, [1])
    assert "end before the last frame" in next(iter(found.excluded))


REFUSED: dict[str, tuple[dict[str, Any], dict[str, Any], type[Exception], str]] = {
    "no videos": ({"video_hz": 0}, {}, UsageError, "has no videos"),
    "a rate that fits no frame": (
        {"video_hz": 4},
        {},
        UsageError,
        "the rate of streams is 10 Hz, valid: a multiple of the videos' rate, which is 4 Hz",
    ),
    "an unknown storage": ({}, {"video": "h264"}, ConfigError, "mp4v, av1, image"),
    "a file without episodes": ({}, {"episodes_per_file": -1}, ConfigError, "episodes_per_file"),
}


@pytest.mark.parametrize("what", REFUSED)
def test_what_cannot_be_exported_is_refused(tmp_path: Path, what: str) -> None:
    changes, settings, error, message = REFUSED[what]
    dataset = make_store(tmp_path / "store.zarr", **changes)
    with pytest.raises(error) as caught:
        dataset.export("lerobot", tmp_path / "out", **settings)
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)
    assert not (tmp_path / "out").exists()


def test_av1_without_its_library_says_how_to_install_it(
    fake: Dataset, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    find = importlib.util.find_spec
    hidden = lambda name, *more: None if name == "av" else find(name, *more)  # noqa: E731
    monkeypatch.setattr("grasp_factory.core.optional.find_spec", hidden)
    with pytest.raises(UsageError, match=r"av, which is not.*pip install 'grasp-factory\[av\]'"):
        fake.export("lerobot", tmp_path / "out", video="av1")
    fake.export("lerobot", tmp_path / "out")


SHORT_OF_SPACE = """
import pathlib, resource, signal, sys
import numpy as np
from grasp_factory.writers.exporters.lerobot.frame_files import frame_file

signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
resource.setrlimit(resource.RLIMIT_FSIZE, (20_000, 20_000))
noise = np.random.default_rng(0)
try:
    with frame_file(pathlib.Path(sys.argv[1]), (160, 120), 10, sys.argv[2]) as video:
        for _ in range(10):
            video.add(noise.integers(0, 255, (120, 160, 3), np.uint8))
except OSError:
    sys.exit(3)
"""
"""A process whose files may have 20 kB, which is like a full disk, writes a larger video."""


@pytest.mark.parametrize("codec", ["mp4v", "av1"])
@pytest.mark.parametrize("place", ["v.mp4", "nowhere/v.mp4"])
def test_a_video_that_cannot_be_written_is_an_error_of_the_disk(
    tmp_path: Path, codec: str, place: str
) -> None:
    command = [sys.executable, "-c", SHORT_OF_SPACE, str(tmp_path / place), codec]
    assert subprocess.run(command, check=False, capture_output=True).returncode == 3


def test_a_folder_has_a_thousand_files(tmp_path: Path) -> None:
    last, first = (new_file(tmp_path, "data", ".parquet", FILES_IN_CHUNK - k) for k in (1, 0))
    names = [str(path.relative_to(tmp_path)) for path in (last, first)]
    assert names == ["data/chunk-000/file-999.parquet", "data/chunk-001/file-000.parquet"]
