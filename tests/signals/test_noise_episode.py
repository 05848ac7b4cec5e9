"""Noise when reading: what changes, what stays, and the same values whichever way they are read."""

from __future__ import annotations

import dataclasses
import pickle
from pathlib import Path

import numpy as np
import pytest
from support.fake_episodes import JOINTS, make_episode, small_config

from grasp_factory.core.episode import Episode
from grasp_factory.dataset.dataset import Dataset
from grasp_factory.errors import UnknownNameError, UsageError
from grasp_factory.signals import BMI088, apply_imu_noise
from grasp_factory.signals.noise import NOISE, STEREO, EpisodeNoise, SensorNoise, named_noise, noisy
from grasp_factory.writers import ZarrWriter
from grasp_factory.writers.zarr.store import prepare_store

CONFIG = small_config()
CHANGED = {
    "rgb": {"cameras/front/rgb"},
    "depth": {"cameras/front/depth"},
    "tactile": {"streams/tactile_wrench", "streams/tactile_force"},
    "wrist": {"streams/wrist_wrench"},
    "encoders": {
        "streams/joint_positions", "streams/joint_velocities", "streams/gripper_width",
    },
    "imu": {"imu/specific_force", "imu/angular_velocity"},
}  # fmt: skip
"""By sensor: all that its noise may touch."""


@pytest.fixture(scope="module")
def path(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("noise") / "store"
    prepare_store(path, CONFIG, JOINTS, 6, {})
    writer = ZarrWriter(path)
    for block, rows in ((0, range(4)), (1, range(4, 6))):
        writer.write_block(block, [episode(i) for i in rows])
    return path


def episode(index: int = 0, n_steps: int = 12) -> Episode:
    """Return a random episode whose cameras see a wall."""
    clean = make_episode(CONFIG, index, n_steps)
    K = np.array([[40.0, 0.0, 16.0], [0.0, 40.0, 11.0], [0.0, 0.0, 1.0]])
    depth = np.broadcast_to(np.linspace(0.6, 1.2, 32, dtype=np.float32), (2, 24, 32)).copy()
    frames = dataclasses.replace(clean.cameras["front"], intrinsics=K, depth=depth)
    return dataclasses.replace(clean, cameras={"front": frames})


def different(a: Episode, b: Episode) -> set[str]:
    theirs = b.contents()
    for name, value in a.contents().items():
        assert (value.dtype, value.shape) == (theirs[name].dtype, theirs[name].shape), name
    return {name for name, v in a.contents().items() if v.tobytes() != theirs[name].tobytes()}


def assert_same(a: np.ndarray, b: np.ndarray) -> None:
    assert (a.dtype, a.shape, a.tobytes()) == (b.dtype, b.shape, b.tobytes())


class TestNoisy:
    @pytest.mark.parametrize("sensor", CHANGED)
    def test_a_sensors_noise_changes_its_own_arrays_and_nothing_else(self, sensor: str) -> None:
        one = SensorNoise(**{sensor: getattr(NOISE["stereo"], sensor)})
        assert different(episode(), noisy(episode(), one)) == CHANGED[sensor]

    @pytest.mark.parametrize("name", ["structured_light", "stereo"])
    def test_a_full_suite_changes_every_sensor_and_no_truth(self, name: str) -> None:
        shown = noisy(episode(), name)
        assert different(episode(), shown) == set().union(*CHANGED.values())
        assert (shown.spec, shown.outcome) == (episode().spec, episode().outcome)
        assert shown.checksum() != episode().checksum()

    def test_no_noise_is_the_same_episode(self) -> None:
        assert noisy(episode(), "none").checksum() == episode().checksum()

    def test_the_same_seed_gives_the_same_bytes_and_another_others(self) -> None:
        a, b, c = (noisy(episode(), "stereo", seed).checksum() for seed in (0, 0, 1))
        assert a == b != c

    def test_one_sensors_noise_does_not_depend_on_the_others(self) -> None:
        alone = SensorNoise(depth=STEREO)
        a, b = noisy(episode(), alone), noisy(episode(), "stereo")
        assert_same(a.cameras["front"].depth, b.cameras["front"].depth)

    def test_frames_cameras_and_episodes_have_noise_of_their_own(self) -> None:
        image = np.full((24, 32, 3), 100, np.uint8)
        noise, K = EpisodeNoise(NOISE["stereo"], 0), np.eye(3)
        seen = {
            noise.image(
                image, K, 4.0, index=index, camera=camera, kind="rgb", frame=frame
            ).tobytes()
            for index in (0, 1)
            for camera in ("front", "left")
            for frame in (0, 1)
        }
        assert len(seen) == 8

    def test_the_imu_reads_as_the_page_on_signals_shows_by_hand(self) -> None:
        clean, shown = episode(3), noisy(episode(3), "stereo", 5)
        force, rate = clean.imu["specific_force"], clean.imu["angular_velocity"]
        by_hand = apply_imu_noise(BMI088, force, rate, clean.spec.imu_hz, seed=[5, 3])
        assert_same(shown.imu["specific_force"], by_hand.specific_force.astype(np.float32))

    def test_an_episode_without_records_is_one_without_noise(self) -> None:
        empty = episode(n_steps=0)
        assert noisy(empty, "stereo").n_steps == 0

    def test_an_unknown_name_lists_the_names(self) -> None:
        with pytest.raises(
            UnknownNameError, match=r"unknown noise 'sterio'; did you mean 'stereo'"
        ):
            noisy(episode(), "sterio")

    @pytest.mark.parametrize("seed", [-1, 0.5, "a", True])
    def test_a_seed_that_is_none_is_refused(self, seed: object) -> None:
        with pytest.raises(UsageError, match=r"noise seed: got .*, valid: a whole number"):
            noisy(episode(), "stereo", seed)  # type: ignore[arg-type]


class TestDataset:
    def test_a_store_reads_clean_unless_it_is_asked(self, path: Path) -> None:
        for dataset in (Dataset(path), Dataset(path, noise="none")):
            assert dataset[1].checksum() == episode(1).checksum()

    @pytest.mark.parametrize("seed", [0, 7])
    @pytest.mark.parametrize("name", ["structured_light", "stereo"])
    def test_every_way_of_reading_gives_the_same_values(
        self, path: Path, name: str, seed: int
    ) -> None:
        dataset = Dataset(path, noise=name, noise_seed=seed)
        assert len(list(dataset)) == 6
        for iterated in dataset:
            index = iterated.spec.index
            want = noisy(episode(index), name, seed)
            assert iterated.checksum() == dataset[index].checksum() == want.checksum()
            for kind in ("rgb", "depth", "segmentation"):
                for frame in (0, 1):
                    expected = getattr(want.cameras["front"], kind)[frame]
                    assert_same(dataset.image(index, "front", kind, frame), expected)
            for stream, values in want.streams.items():
                assert_same(dataset.series(index, stream)[stream], values)

    def test_columns_labels_recipes_and_the_verdict_stay_clean(self, path: Path) -> None:
        clean, shown = Dataset(path), Dataset(path, noise="stereo")
        assert all(shown.verify(i) for i in shown.committed)
        for column in clean.columns:
            np.testing.assert_array_equal(shown.column(column), clean.column(column))
        rows = clean.where(success=True).indices.tolist()
        assert shown.where(success=True).indices.tolist() == rows
        assert shown.spec(2) == clean.spec(2)

    def test_a_suite_of_ones_own_is_taken(self, path: Path) -> None:
        wild = SensorNoise(depth=dataclasses.replace(STEREO, edge_loss=1.0))
        dataset = Dataset(path, noise=wild)
        assert different(episode(), dataset[0]) == CHANGED["depth"]

    def test_it_travels_to_another_process_with_its_noise(self, path: Path) -> None:
        dataset = Dataset(path, noise="stereo", noise_seed=9)
        there = pickle.loads(pickle.dumps(dataset))
        assert there[1].checksum() == dataset[1].checksum()

    def test_a_wrong_name_is_refused_before_the_store_is_looked_for(self, tmp_path: Path) -> None:
        with pytest.raises(UnknownNameError, match="unknown noise"):
            Dataset(tmp_path / "none", noise="loud")


def test_the_suites_are_complete_and_differ_in_depth_alone() -> None:
    light, stereo = named_noise("structured_light"), named_noise("stereo")
    assert None not in dataclasses.astuple(stereo)
    assert dataclasses.replace(light, depth=stereo.depth) == stereo
    assert named_noise(None) == SensorNoise()
