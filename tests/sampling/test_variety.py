"""Randomisation, clutter, cameras and video in whole episodes and whole stores."""

from __future__ import annotations

import dataclasses
import subprocess
import sys
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from support.helpers import assert_same_tree
from support.scale import scaled
from support.scenes import SMALL

from grasp_factory.core.config.cameras import CAMERAS
from grasp_factory.core.config.factory_config import FactoryConfig
from grasp_factory.core.config.randomization import RANDOMIZE_PRESETS
from grasp_factory.core.config.scene import ClutterConfig
from grasp_factory.core.enums import Label, Outcome, Phase
from grasp_factory.core.episode import Episode
from grasp_factory.core.geometry import Pose, apply
from grasp_factory.dataset.dataset import Dataset
from grasp_factory.factory.generate import generate
from grasp_factory.labels.rule import disturbance
from grasp_factory.sampling.spec import sample_spec
from grasp_factory.simulation.rollout import run_episode
from grasp_factory.simulation.world import World

pytestmark = pytest.mark.slow

ALL_CAMERAS = {name: camera.config for name, camera in CAMERAS.items()}
COMMAND = [sys.executable, "-m", "grasp_factory", "generate"]
STRONG = (
    "--randomize", "strong", "--clutter", "3", "--camera", "front", "--camera", "wrist",
    "--objects", "procedural", "--objects", "classic", "--resolution", "64x48",
    "--video-hz", "4", "--set", "block_size=2", "--quiet",
)  # fmt: skip
MADE = scaled(6, 10)
"""Episodes in clutter."""


@pytest.fixture(scope="module")
def world() -> Iterator[World]:
    with World() as world:
        yield world


def variant(**changes: Any) -> FactoryConfig:
    return dataclasses.replace(SMALL, **changes)


@cache
def cluttered(count: int) -> tuple[Episode, ...]:
    config = variant(
        clutter=ClutterConfig(count=4), policies={"top_down": 1.0}, object_sets={"procedural": 1.0}
    )
    with World() as world:
        return tuple(run_episode(world, sample_spec(config, i)) for i in range(count))


class TestLooks:
    @pytest.mark.soak
    def test_two_presets_that_differ_in_looks_alone_have_the_same_physics(
        self, world: World
    ) -> None:
        """The same bytes: streams, IMU, labels, measurements, depth and segmentation.

        But for what is measured on the colours.
        """
        of_colours = {"episodes/sharpness", "episodes/exposure", "episodes/clipped"}
        for index in range(6):
            a, b = (
                run_episode(
                    world, sample_spec(variant(randomize=RANDOMIZE_PRESETS[preset]), index)
                ).contents()
                for preset in ("none", "looks")
            )
            differ = {path for path in a if a[path].tobytes() != b[path].tobytes()}
            assert differ - of_colours == {"episodes/spec", "cameras/front/rgb"}


class TestDeterminism:
    @pytest.mark.soak
    def test_strong_gives_the_same_bytes_for_any_number_of_workers(self, tmp_path: Path) -> None:
        for workers in (1, 3):
            run = [*COMMAND, *STRONG, "--n", "5", "--workers", str(workers)]
            subprocess.run([*run, "--out", str(tmp_path / f"{workers}.zarr")], check=True)
        assert_same_tree(tmp_path / "1.zarr", tmp_path / "3.zarr")
        dataset = Dataset(tmp_path / "1.zarr")
        assert [i for i in range(5) if not dataset.verify(i)] == []

    @pytest.mark.soak
    def test_an_episode_does_not_depend_on_what_was_made_before(self, world: World) -> None:
        config = variant(
            randomize=RANDOMIZE_PRESETS["strong"],
            cameras=ALL_CAMERAS,
            clutter=ClutterConfig(count=3),
        )
        specs = [sample_spec(config, index) for index in range(5)]
        forward = [run_episode(world, spec).checksum() for spec in specs]
        with World() as fresh:
            backward = [run_episode(fresh, spec).checksum() for spec in reversed(specs)]
        assert forward == backward[::-1]


class TestRandomizedBodies:
    def test_the_engine_gets_what_the_recipe_says(self, world: World) -> None:
        ranges = RANDOMIZE_PRESETS["strong"]
        config = variant(randomize=ranges, object_sets={"procedural": 1.0, "classic": 1.0})
        for index in range(8):
            spec = sample_spec(config, index)
            episode = run_episode(world, spec)
            assert episode.columns["object_mass"] == spec.objects[0].mass
            loaded = world.mass(_target_body(world))
            assert loaded == pytest.approx(spec.objects[0].mass)

    @pytest.mark.parametrize("object_set", ["procedural", "blobs", "classic"])
    def test_an_object_of_twice_the_size_covers_four_times_the_pixels(
        self, world: World, object_set: str
    ) -> None:
        config = variant(object_sets={object_set: 1.0}, policies={"top_down": 1.0})
        spec = sample_spec(config, 3)
        pixels = []
        for scale in (0.5, 1.0):
            target = dataclasses.replace(spec.objects[0], scale=scale)
            episode = run_episode(world, dataclasses.replace(spec, objects=(target,)))
            pixels.append((episode.cameras["front"].segmentation[0] == Label.TARGET).sum())
        assert 2.2 < pixels[1] / pixels[0] < 6.0


def _target_body(world: World) -> int:
    """Return the target's body: floor, table and robot come before it."""
    return 3


class TestClutter:
    @pytest.mark.soak
    def test_every_object_has_its_pose_label_and_share(self) -> None:
        for episode in cluttered(MADE):
            recipes = episode.spec.objects
            assert len(recipes) == 4
            assert episode.columns["object_ids"].tolist() == [r.object_id for r in recipes]
            assert episode.columns["object_rest_pose"].shape == (4, 7)
            assert episode.streams["object_pose"].shape[1:] == (4, 7)
            frames = episode.cameras["front"]
            assert frames.visibility.shape == (2, 4)
            for i, share in enumerate(frames.visibility[0]):
                seen = (frames.segmentation[0] == Label.TARGET + i).any()
                assert seen == (share > 0.0)

    def test_the_column_of_the_target_is_the_first_object(self) -> None:
        for episode in cluttered(MADE):
            assert episode.columns["object_id"] == episode.columns["object_ids"][0]
            if episode.n_steps:
                lift = episode.columns["object_lift"][0]
                if episode.outcome is Outcome.SUCCESS:
                    assert lift == pytest.approx(episode.columns["lift_height"], abs=1e-5)

    def test_success_is_about_the_target(self) -> None:
        outcomes = [episode.outcome for episode in cluttered(MADE)]
        assert Outcome.SUCCESS in outcomes
        for episode in cluttered(MADE):
            if episode.outcome is Outcome.SUCCESS:
                assert episode.columns["object_lift"][0] > 0.1

    def test_what_lies_apart_from_the_attempt_stays_where_it_is(self) -> None:
        still = [e.columns["object_displacement"][1:] for e in cluttered(MADE) if e.n_steps]
        assert np.median(np.concatenate(still)) < 0.001

    def test_rest_poses_are_those_of_the_first_record_where_nothing_was_touched_yet(self) -> None:
        for episode in cluttered(MADE):
            if episode.n_steps:
                first = episode.streams["object_pose"][0].astype(np.float64)
                rest = episode.columns["object_rest_pose"]
                assert np.abs(first[:, :3] - rest[:, :3]).max() < 0.002


class TestDisturbance:
    def test_way_and_rise_are_those_of_centers_of_mass(self) -> None:
        com = np.array([[0.0, 0.0, 0.0], [0.1, 0.0, 0.0]])
        rest = np.array([[0, 0, 0, 0, 0, 0, 1.0], [1, 0, 0, 0, 0, 0, 1.0]])
        half_turn = [1.2, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0]  # about z: the centre stays at x = 1.1
        poses = np.array(
            [
                [[0, 0, 0.3, 0, 0, 0, 1.0], half_turn],
                [[0, 0.4, 0.3, 0, 0, 0, 1.0], half_turn],
            ],
            np.float32,
        )
        phase = np.array([Phase.HOLD, Phase.SHAKE], np.uint8)
        way, rise = disturbance({"phase": phase, "object_pose": poses}, com, rest)
        assert way == pytest.approx([0.5, 0.0], abs=1e-6)
        assert rise == pytest.approx([0.3, 0.0], abs=1e-6)

    def test_without_an_attempt_there_is_neither(self) -> None:
        streams = {"phase": np.zeros(0, np.uint8), "object_pose": np.zeros((0, 2, 7), np.float32)}
        way, rise = disturbance(streams, np.zeros((2, 3)), np.zeros((2, 7)))
        assert np.isnan(way).all()
        assert np.isnan(rise).all()


class TestVideo:
    def test_its_frames_follow_the_arm(self, world: World) -> None:
        config = variant(video_hz=8, cameras=ALL_CAMERAS, policies={"top_down": 1.0})
        episode = next(
            e for i in range(9) if (e := run_episode(world, sample_spec(config, i))).success
        )
        videos, times = episode.videos, episode.videos["timestamp"]
        assert set(videos) == {"timestamp"} | {
            f"{name}/{kind}" for name in ALL_CAMERAS for kind in ("rgb", "T_world_camera")
        }
        assert np.diff(times) == pytest.approx(1 / 8)
        duration = episode.streams["timestamp"][-1]
        assert times[-1] == pytest.approx(duration, abs=1 / 8)
        assert videos["front/rgb"].shape == (len(times), 120, 160, 3)
        assert np.ptp(videos["front/T_world_camera"], axis=0).max() == 0.0
        records = np.searchsorted(episode.streams["timestamp"], times - 1e-9)
        offset = np.array(ALL_CAMERAS["wrist"].eye)
        for record, T in zip(records, videos["wrist/T_world_camera"], strict=True):
            x, y, z, *quat = episode.streams["tcp_pose"][record].astype(float)
            expected = apply(Pose((x, y, z), tuple(quat)).matrix(), offset)
            assert T[:3, 3] == pytest.approx(expected, abs=1e-5)
        moved = np.abs(np.diff(videos["front/rgb"].astype(int), axis=0)).max(axis=(1, 2, 3))
        assert (moved > 0).mean() > 0.8

    def test_it_changes_nothing_else(self, world: World) -> None:
        plain, filmed = (run_episode(world, sample_spec(variant(video_hz=hz), 2)) for hz in (0, 8))
        assert plain.videos == {}
        a, b = plain.contents(), filmed.contents()
        for path in a:
            if path != "episodes/spec" and not path.endswith("/rgb"):
                assert a[path].tobytes() == b[path].tobytes(), path

    def test_it_comes_back_from_a_store_frame_for_frame(self, tmp_path: Path) -> None:
        config = variant(video_hz=4, block_size=2, resolution=(48, 32))
        generate(config, 3, tmp_path / "s.zarr", workers=1)
        dataset = Dataset(tmp_path / "s.zarr")
        with World() as world:
            for index in range(3):
                episode = run_episode(world, sample_spec(config, index))
                assert dataset[index].checksum() == episode.checksum()
                assert dataset.verify(index)
        for indices, episodes in dataset.iter_blocks():
            for index, episode in zip(indices, episodes, strict=True):
                assert episode.checksum() == dataset[int(index)].checksum()
