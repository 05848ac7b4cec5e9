"""Exports that are killed at random instants: the next run completes them, with the same bytes."""

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
from support.exporter_contract import CAMERAS_OF_STORES
from support.fake_episodes import JOINTS, make_rows, small_config
from support.helpers import assert_same_tree
from support.scale import scaled

from grasp_factory.writers.zarr.store import prepare_store
from grasp_factory.writers.zarr.writer import ZarrWriter

pytestmark = pytest.mark.slow
ROWS = 40
KILLS = scaled(5, 20)


@pytest.fixture(scope="module")
def store(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("source") / "store.zarr"
    config = small_config(video_hz=5, cameras=CAMERAS_OF_STORES)
    prepare_store(path, config, JOINTS, ROWS, {})
    for block in range(ROWS // config.block_size):
        ZarrWriter(path).write_block(block, make_rows(config, block, ROWS))
    return path


def start(store: Path, out: Path) -> subprocess.Popen[str]:
    command = [sys.executable, "-m", "grasp_factory", "export", store, out, "--to", "sequences"]
    return subprocess.Popen(
        [*map(str, command), "--workers", "2"],
        start_new_session=True,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
    )


def finish(run: subprocess.Popen[str]) -> None:
    _, said = run.communicate(timeout=120)
    assert (run.returncode, said) == (0, "")


def test_an_export_that_is_killed_is_complete_or_not_there(store: Path, tmp_path: Path) -> None:
    clean, out = tmp_path / "clean", tmp_path / "exports" / "out"
    out.parent.mkdir()
    begun = time.monotonic()
    finish(start(store, clean))
    seconds = time.monotonic() - begun
    rng = np.random.default_rng(0)
    for kill in range(KILLS):
        run = start(store, out)
        time.sleep(seconds * rng.uniform(0.3, 1.0))  # imports take the first third
        if kill % 2:
            os.kill(run.pid, signal.SIGKILL)
        else:
            os.killpg(run.pid, signal.SIGKILL)
        run.communicate(timeout=60)  # workers hold the pipe until they end
        if out.exists():
            assert_same_tree(clean, out)
            shutil.rmtree(out)
        left = [path.name for path in out.parent.iterdir()]
        assert all(name.startswith(".out.exporting-") for name in left)
    finish(start(store, out))
    assert_same_tree(clean, out)
    assert list(out.parent.iterdir()) == [out]
