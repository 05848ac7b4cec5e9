"""The command line for real: same bytes for any workers, order, resume or growth."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time

import pytest
from support.helpers import assert_same_tree
from support.scale import scaled, soak_only

from grasp_factory.dataset.dataset import Dataset

pytestmark = pytest.mark.slow
N = scaled(10, 14)
TINY = ("--resolution", "96x72", "--set", "block_size=4", "--quiet")


def generate(out, n=N, workers=1, check=True):
    command = [sys.executable, "-m", "grasp_factory", "generate", "--n", str(n),
               "--seed", "3", "--workers", str(workers), "--out", str(out), *TINY]  # fmt: skip
    return subprocess.run(command, capture_output=True, check=check, text=True)


@pytest.fixture(scope="module")
def alone(tmp_path_factory):
    """The store that one worker makes in one go."""
    path = tmp_path_factory.mktemp("alone") / "ds.zarr"
    generate(path)
    return path


@pytest.mark.parametrize("workers", soak_only(2, 3))
def test_the_number_of_workers_does_not_change_a_byte(alone, tmp_path, workers):
    generate(tmp_path / "ds.zarr", workers=workers)
    assert_same_tree(alone, tmp_path / "ds.zarr")


@pytest.mark.soak
def test_growing_step_by_step_gives_the_bytes_of_one_run(alone, tmp_path):
    for n in (2, 5, N):
        generate(tmp_path / "ds.zarr", n=n, workers=2)
    assert_same_tree(alone, tmp_path / "ds.zarr")


@pytest.mark.parametrize("stop", soak_only(signal.SIGKILL, signal.SIGINT, signal.SIGTERM))
def test_a_run_that_was_stopped_is_completed_to_the_same_bytes(alone, tmp_path, stop):
    out = tmp_path / "ds.zarr"
    command = [sys.executable, "-m", "grasp_factory", "generate", "--n", str(N), "--seed", "3",
               "--workers", "2", "--out", str(out), *TINY]  # fmt: skip
    run = subprocess.Popen(command, start_new_session=True, stderr=subprocess.DEVNULL)
    deadline = time.monotonic() + 60
    while time.monotonic() < deadline and not any(out.glob("streams/phase/[0-9]*")):
        time.sleep(0.02)
    os.killpg(run.pid, stop)
    run.wait(timeout=60)
    assert len(Dataset(out).committed) < N
    generate(out, workers=2)
    assert_same_tree(alone, out)


def test_the_same_command_again_changes_nothing(alone):
    def state():
        return {file: file.stat().st_mtime_ns for file in alone.rglob("*")}

    before = state()
    generate(alone)
    assert state() == before


@pytest.mark.soak
def test_replay_agrees_with_every_episode(alone):
    for index in range(0, N, 5):
        command = [sys.executable, "-m", "grasp_factory", "replay", str(alone), str(index)]
        subprocess.run(command, check=True, capture_output=True)
