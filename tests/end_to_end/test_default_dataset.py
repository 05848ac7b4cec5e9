"""Default episodes, made by the command line, against what the README promises."""

from __future__ import annotations

import json
import subprocess
import sys
from collections import Counter

import numpy as np
import pytest
from support.scale import scaled

from grasp_factory.core.enums import Outcome, Phase
from grasp_factory.core.geometry import quat_xyzw_to_matrix
from grasp_factory.dataset.dataset import Dataset
from grasp_factory.labels.rule import target_com
from grasp_factory.robots import ROBOTS

pytestmark = pytest.mark.slow
EPISODES = scaled(48, 200)
STILL = 0.005
"""m/s of the target's centre of mass: slower counts as at rest."""


@pytest.fixture(scope="module")
def dataset(tmp_path_factory):
    path = tmp_path_factory.mktemp("default") / "grasps.zarr"
    command = [sys.executable, "-m", "grasp_factory", "generate", "--n", str(EPISODES),
               "--seed", "0", "--workers", "2", "--out", str(path), "--json"]  # fmt: skip
    done = subprocess.run(command, capture_output=True, check=True, text=True)
    assert json.loads(done.stdout)["made"] == EPISODES
    return Dataset(path)


@pytest.fixture(scope="module")
def episodes(dataset):
    """Everything but the images, which would not fit in memory."""
    return [dataset[i] for i in dataset.committed]


@pytest.fixture(scope="module")
def held_at_rest(episodes):
    """Forces in units of the target's weight over all still records of all holds."""
    pads, wrist = [], []
    for episode in episodes:
        streams = episode.streams
        if not episode.success:
            continue
        com = target_com(streams, np.asarray(episode.columns["object_com"])[0])
        speed = np.linalg.norm(np.gradient(com, 1 / 120, axis=0), axis=1)
        rest = np.flatnonzero((streams["phase"] == Phase.HOLD) & (speed < STILL))
        R = [quat_xyzw_to_matrix(pose[3:]) for pose in streams["tcp_pose"][rest]]
        weight = episode.columns["object_mass"] * 9.81 * np.array([0, 0, -1.0])
        tool = ROBOTS[episode.spec.robot].tool_mass * 9.81 * np.array([0, 0, -1.0])
        on_pads = streams["tactile_wrench"][rest, :, :3].astype(float).sum(axis=1)
        on_wrist = streams["wrist_wrench"][rest, :3].astype(float)
        for force, tare, errors in ((on_pads, 0.0, pads), (on_wrist, tool, wrist)):
            world = np.einsum("sij,sj->si", np.reshape(R, (-1, 3, 3)), force) - tare
            errors.extend(np.linalg.norm(world - weight, axis=1) / np.linalg.norm(weight))
    assert len(pads) > 10 * EPISODES
    return np.array(pads), np.array(wrist)


def test_forty_to_sixty_percent_succeed(dataset):
    assert len(dataset.committed) == EPISODES
    assert 0.40 <= dataset.column("success").mean() <= 0.60


def test_every_policy_gives_both_classes(dataset):
    for policy in dataset.config.policies:
        success = dataset.column("success")[dataset.column("policy") == policy]
        assert len(success) > EPISODES / 5
        assert success.any()
        assert not success.all()


def test_there_are_at_least_three_outcomes_besides_success(dataset):
    counts = Counter(Outcome(value) for value in dataset.column("outcome"))
    assert len(set(counts) - {Outcome.SUCCESS}) >= 3


def test_the_pads_forces_sum_to_the_weight_of_what_is_held_at_rest(held_at_rest):
    pads, _ = held_at_rest
    assert np.median(pads) <= 0.02
    assert np.percentile(pads, 95) <= 0.05


def test_the_wrist_reads_the_tools_weight_and_what_is_held_at_rest(held_at_rest):
    _, wrist = held_at_rest
    assert np.median(wrist) <= 0.02
    assert np.percentile(wrist, 95) <= 0.05


def test_an_episode_takes_less_than_a_megabyte(dataset):
    size = sum(file.stat().st_size for file in dataset.path.rglob("*") if file.is_file())
    assert size / EPISODES < 1e6


@pytest.mark.parametrize("index", [0, EPISODES // 2 + 1, EPISODES - 1])
def test_replay_gives_the_same_bytes(dataset, index):
    command = [sys.executable, "-m", "grasp_factory", "replay", str(dataset.path), str(index)]
    done = subprocess.run(command, capture_output=True, check=False, text=True)
    assert done.returncode == 0, done.stdout + done.stderr
