"""The format `robomimic`, read with h5py; `bin/check-exports robomimic` reads with its own."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import h5py
import numpy as np
import pytest
from support.exporter_contract import cameras, make_store
from support.fake_episodes import JOINTS, make_episode, small_config
from support.stored import varied

from grasp_factory.dataset.dataset import Dataset
from grasp_factory.errors import ConfigError, UsageError
from grasp_factory.writers.exporters.robomimic import ActionBounds
from grasp_factory.writers.zarr.store import prepare_store
from grasp_factory.writers.zarr.writer import ZarrWriter


@pytest.fixture(scope="module")
def dataset() -> Dataset:
    return Dataset(varied())


@pytest.fixture(scope="module")
def file(dataset: Dataset, tmp_path_factory: pytest.TempPathFactory) -> Iterator[h5py.File]:
    out = tmp_path_factory.mktemp("robomimic") / "out"
    dataset.export("robomimic", out)
    with h5py.File(out / "demo.hdf5") as file:
        yield file


def test_every_array_is_read_back_at_the_video_rate(dataset: Dataset, file: h5py.File) -> None:
    assert len(file["data"]) == len(dataset.committed)
    for k, episode in enumerate(dataset):
        demo = file[f"data/demo_{k}"]
        streams, videos = episode.streams, episode.videos
        clock = streams["timestamp"]
        at = [np.flatnonzero(clock <= time)[-1] for time in videos["timestamp"]]
        assert demo.attrs["num_samples"] == len(at)
        seen = {"video_timestamp"}
        for name, values in streams.items():
            if name != "reward":
                np.testing.assert_array_equal(demo[f"obs/{name}"], values[at], strict=True)
                seen.add(name)
        for path, values in videos.items():
            if path != "timestamp":
                name = path.replace("/rgb", "_image").replace("/", "_")
                np.testing.assert_array_equal(demo[f"obs/{name}"], values, strict=True)
                seen.add(name)
        np.testing.assert_array_equal(demo["obs/video_timestamp"], videos["timestamp"])
        assert set(demo["obs"]) == set(demo["next_obs"]) == seen
        np.testing.assert_array_equal(demo["dones"], [*[0] * (len(at) - 1), 1])
        assert demo["rewards"][()].sum() == demo["rewards"][-1] == episode.success


def test_the_next_observation_is_that_of_the_next_step(file: h5py.File) -> None:
    for demo in file["data"].values():
        for name, values in demo["obs"].items():
            after = demo["next_obs"][name]
            np.testing.assert_array_equal(after[:-1], values[1:], strict=True)
            np.testing.assert_array_equal(after[-1:], values[-1:], strict=True)


def test_actions_are_in_the_unit_range_and_can_be_scaled_back(
    dataset: Dataset, file: h5py.File
) -> None:
    data = file["data"]
    scale, offset = data.attrs["action_scale"], data.attrs["action_offset"]
    actions = np.concatenate([demo["actions"] for demo in data.values()])
    assert actions.dtype == np.float32
    assert (actions.min(), actions.max()) == (-1.0, 1.0)
    for k, episode in enumerate(dataset):
        demo, streams = data[f"demo_{k}"], episode.streams
        target = np.c_[streams["joint_position_targets"], streams["gripper_width_target"]]
        absolute = demo["actions_absolute"]
        clock, times = streams["timestamp"], episode.videos["timestamp"][1:]
        at = [*(np.flatnonzero(clock <= time)[-1] for time in times), -1]
        np.testing.assert_array_equal(absolute, target[at], strict=True)
        np.testing.assert_allclose(demo["actions"] * scale + offset, absolute, atol=1e-6)


def test_a_number_that_is_constant_becomes_0_and_nan_does_not_count() -> None:
    bounds = ActionBounds.of([np.array([2.0, -1.0, np.nan])], [np.array([2.0, 3.0, np.nan])])
    np.testing.assert_array_equal(bounds.offset, [2.0, 1.0, np.nan])
    np.testing.assert_array_equal(bounds.scale, [1.0, 2.0, 1.0])


def test_the_masks_are_the_splits_and_the_successes(tmp_path: Path) -> None:
    dataset = make_store(tmp_path / "store.zarr")
    out = dataset.export("robomimic", tmp_path / "out").path
    lines = (out / "grasp_factory_episodes.jsonl").read_text().splitlines()
    episodes = [json.loads(line) for line in lines]
    assert {line["columns"]["split"] for line in episodes} >= {"train", "val"}
    with h5py.File(out / "demo.hdf5") as file:
        for mask, split in {"train": "train", "valid": "val", "test": "test"}.items():
            of_split = [e for e in episodes if e["columns"]["split"] == split]
            good = [e for e in of_split if e["columns"]["outcome"] == "success"]
            for name, members in ((mask, of_split), (f"success_{mask}", good)):
                found = [text.decode() for text in file[f"mask/{name}"]]
                assert found == [f"demo_{e['episode']}" for e in members]
        assert file["data"].attrs["total"] == sum(
            demo.attrs["num_samples"] for demo in file["data"].values()
        )


def test_the_environment_has_a_type_that_robomimic_knows(file: h5py.File) -> None:
    environment = json.loads(file["data"].attrs["env_args"])
    assert environment["type"] == 2
    assert environment["env_kwargs"]["control_freq"] == 10
    assert environment["env_kwargs"]["cameras"] == ["front", "wrist"]


def test_episodes_without_frames_are_left_out_and_counted(tmp_path: Path) -> None:
    config = small_config(video_hz=5)
    prepare_store(tmp_path / "store.zarr", config, JOINTS, 3, {})
    rows = [make_episode(config, i, n_steps) for i, n_steps in enumerate((8, 0, 1))]
    ZarrWriter(tmp_path / "store.zarr").write_block(0, list(rows))
    found = Dataset(tmp_path / "store.zarr").export("robomimic", tmp_path / "out")
    assert (found.episodes, list(found.excluded.values())) == (1, [2])
    with h5py.File(tmp_path / "out/demo.hdf5") as file:
        assert list(file["data"]) == ["demo_0"]
        assert file["data/demo_0"].attrs["num_samples"] == 4


def test_a_camera_may_have_any_letters_in_its_name(tmp_path: Path) -> None:
    named = {"überkopf": cameras("overhead")["overhead"]}
    dataset = make_store(tmp_path / "store.zarr", cameras=named)
    out = dataset.export("robomimic", tmp_path / "out", [0]).path
    with h5py.File(out / "demo.hdf5") as file:
        for group in ("obs", "next_obs"):
            images = file[f"data/demo_0/{group}/überkopf_image"]
            np.testing.assert_array_equal(images[-1], dataset[0].videos["überkopf/rgb"][-1])


def test_a_store_without_videos_is_refused_with_what_to_do(tmp_path: Path) -> None:
    dataset = make_store(tmp_path / "store.zarr", video_hz=0)
    with pytest.raises(UsageError, match=r"has no videos.*: generate .* with --video-hz 10"):
        dataset.export("robomimic", tmp_path / "out")


def test_images_are_stored_once_and_compressed_as_asked_for(
    dataset: Dataset, file: h5py.File, tmp_path: Path
) -> None:
    out = dataset.export("robomimic", tmp_path / "out", gzip=0).path
    image = "data/demo_0/obs/front_image"
    with h5py.File(out / "demo.hdf5") as plain:
        assert (plain[image].compression, file[image].compression) == (None, "gzip")
        assert plain["data/demo_0/next_obs/front_image"].is_virtual
        assert file[image].chunks == (1, 72, 96, 3)
    with pytest.raises(ConfigError, match=r"robomimic.gzip: got 10, valid: 0 to 9"):
        dataset.export("robomimic", tmp_path / "other", gzip=10)


def test_other_formats_do_not_need_h5py() -> None:
    code = "import sys, grasp_factory.writers.exporters; print('h5py' in sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout == "False\n"


FULL = """
import resource, sys
from pathlib import Path
import numpy as np
from grasp_factory.writers.exporters.hdf5_file import NewHdf5File
resource.setrlimit(resource.RLIMIT_FSIZE, (int(sys.argv[2]), resource.RLIM_INFINITY))
try:
    with NewHdf5File(Path(sys.argv[1])) as new:
        for k in range(3):
            values = np.random.default_rng(k).integers(0, 255, (9, 999), np.uint8)
            new.file.create_dataset(str(k), data=values, chunks=(1, 999), compression="gzip")
            assert (new.file[str(k)][()] == values).all()
except OSError as error:
    print(error.strerror)
"""


@pytest.mark.parametrize("size", [0, 700, 20_000])
def test_a_full_disk_is_an_error_and_does_not_end_the_process(tmp_path: Path, size: int) -> None:
    command = [sys.executable, "-c", FULL, str(tmp_path / "full.hdf5"), str(size)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout, done.stderr) == (0, "File too large\n", "")
