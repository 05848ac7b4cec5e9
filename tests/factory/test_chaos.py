"""Runs that are killed at random instants, then started again: the bytes of a clean run, always."""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from support.helpers import assert_same_tree
from support.scale import scaled

from grasp_factory.dataset.dataset import Dataset

pytestmark = [pytest.mark.slow, pytest.mark.timeout(900)]
N = 8
RUNS = scaled(1, 30)
FEWER = 5
"""Of a store that is then grown: its last block is cut short."""
COMMAND = (
    *(sys.executable, "-m", "grasp_factory", "generate", "--seed", "3", "--workers", "2"),
    *("--resolution", "48x36", "--set", "block_size=2", "--quiet"),
)


def start(out: Path, n: int = N) -> subprocess.Popen[str]:
    command = [*COMMAND, "--n", str(n), "--out", str(out)]
    return subprocess.Popen(command, start_new_session=True, stderr=subprocess.PIPE, text=True)


def finish(run: subprocess.Popen[str]) -> None:
    _, said = run.communicate(timeout=120)
    assert run.returncode == 0, said


@pytest.fixture(scope="module")
def clean(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, float]:
    """Return a store that was made in one go, and the seconds that took."""
    path, begun = tmp_path_factory.mktemp("clean") / "ds.zarr", time.monotonic()
    finish(start(path))
    return path, time.monotonic() - begun


@pytest.fixture(scope="module")
def fewer(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("fewer") / "ds.zarr"
    finish(start(path, FEWER))
    return path


def workers_of(pid: int) -> list[int]:
    """Return the worker processes of a coordinator."""
    try:
        children = Path(f"/proc/{pid}/task/{pid}/children").read_text().split()
        commands = {int(c): Path(f"/proc/{c}/cmdline").read_bytes() for c in children}
    except FileNotFoundError:  # one of them has just ended
        return []
    return [child for child, command in commands.items() if b"spawn_main" in command]


def kill(victim: str, pid: int, rng: np.random.Generator) -> None:
    if victim == "the group":
        os.killpg(pid, signal.SIGKILL)
    elif victim == "the coordinator":
        os.kill(pid, signal.SIGKILL)
    elif workers := workers_of(pid):
        os.kill(int(rng.choice(workers)), signal.SIGKILL)


def wait_for_group(pid: int) -> None:
    """Wait until no process of a group runs: orphaned workers end by themselves."""
    deadline = time.monotonic() + 20.0
    while time.monotonic() < deadline:
        try:
            os.killpg(pid, 0)
        except ProcessLookupError:
            return
        time.sleep(0.02)
    raise AssertionError(f"processes of group {pid} are left")


@pytest.mark.parametrize("number", range(RUNS))
def test_a_run_that_is_killed_and_resumed_has_the_bytes_of_a_clean_one(
    clean: tuple[Path, float], fewer: Path, tmp_path: Path, number: int
) -> None:
    want, seconds = clean
    rng = np.random.default_rng(number)
    victim = ("the coordinator", "one worker", "the group")[number % 3]
    out = tmp_path / "ds.zarr"
    there = FEWER if number % 2 else 0
    if there:
        shutil.copytree(fewer, out)
    run = start(out)
    try:
        time.sleep(rng.uniform(0.0, seconds))
        if run.poll() is None:
            kill(victim, run.pid, rng)
        if victim == "one worker":
            finish(run)
    finally:
        run.kill()
        run.communicate()
    wait_for_group(run.pid)
    if there:
        assert set(range(there)) <= set(Dataset(out).committed.tolist())
    finish(start(out))
    assert Dataset(out).committed.tolist() == list(range(N))
    assert_same_tree(want, out)
    left = {path.name for path in tmp_path.iterdir()} - {"ds.zarr", "ds.zarr.runs.jsonl"}
    assert left == set()
