"""Episodes that kill, hang or break their worker: each costs itself and nothing else."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
from support.helpers import assert_same_tree
from support.places import REPOSITORY
from support.sabotage import SABOTAGE

from grasp_factory.core.config.factory_config import FactoryConfig
from grasp_factory.dataset.dataset import Dataset
from grasp_factory.sampling.spec import sample_spec

pytestmark = [pytest.mark.slow, pytest.mark.timeout(240)]
N = 12
TINY = ("--seed", "3", "--resolution", "48x36", "--set", "block_size=4")


def generate(
    out: Path, deeds: dict[int, str] | None = None, *args: Any, workers: int = 2
) -> subprocess.CompletedProcess[str]:
    """Run the command; a worker does the deed of an episode before it makes it."""
    lines = [f"if spec.index == {i}: {deed}" for i, deed in (deeds or {}).items()]
    place = out.parent / "site"
    place.mkdir(exist_ok=True)
    (place / "sitecustomize.py").write_text(
        SABOTAGE.format(deeds="\n        ".join(lines) or "pass")
    )
    command = [sys.executable, "-m", "grasp_factory", "generate", "--n", N, "--out", out]
    return subprocess.run(
        [str(word) for word in (*command, "--workers", workers, *TINY, *args)],
        env=os.environ | {"PYTHONPATH": f"{place}:{REPOSITORY}"},
        capture_output=True,
        check=False,
        text=True,
    )


@pytest.fixture(scope="module")
def clean(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("clean") / "ds.zarr"
    done = generate(path)
    assert done.returncode == 0, done.stderr
    return path


def checksums(path: Path) -> dict[int, str]:
    dataset = Dataset.open(path)
    column = dataset.column("checksum")
    return {int(i): column[i] for i in dataset.committed}


@pytest.mark.parametrize(
    ("deed", "reason"),
    [
        ("os.kill(os.getpid(), signal.SIGSEGV)", r"its worker was lost twice (SIGSEGV)"),
        ("os.kill(os.getpid(), signal.SIGKILL)", r"its worker was lost twice (SIGKILL)"),
        ("os._exit(3)", r"its worker was lost twice (exit code 3)"),
        ("raise MemoryError", r"its worker was lost twice (SIGKILL)"),
        ("raise ValueError('two\\nlines')", r"ValueError: two lines"),
        ("time.sleep(1e6)", r"its worker was lost twice (silent for more than 8 s)"),
        ("os.kill(os.getpid(), signal.SIGSTOP)", "lost twice (silent for more than 8 s)"),
    ],
)
def test_an_episode_that_cannot_be_made_is_quarantined_alone(
    clean: Path, tmp_path: Path, deed: str, reason: str
) -> None:
    out = tmp_path / "ds.zarr"
    done = generate(out, {5: deed}, "--episode-timeout", 8, "--json")
    assert done.returncode == 0, done.stderr
    assert reason in done.stderr
    summary = json.loads(done.stdout)
    assert list(summary["quarantined"]) == ["5"]
    assert reason in summary["quarantined"]["5"]
    want = checksums(clean)
    del want[5]
    assert checksums(out) == want
    config = FactoryConfig.from_plain(Dataset.open(out).attributes["config"])
    assert Dataset.open(out).spec(5) == sample_spec(config, 5)


def test_deaths_give_the_same_bytes_for_any_number_of_workers(tmp_path: Path) -> None:
    deeds = {0: "os._exit(3)", 5: "raise ValueError('no')", 6: "os._exit(3)"}
    stores = [tmp_path / f"{workers}.zarr" for workers in (1, 2, 3)]
    for workers, out in enumerate(stores, 1):
        assert generate(out, deeds, workers=workers).returncode == 0
    assert_same_tree(stores[0], stores[1])
    assert_same_tree(stores[0], stores[2])


def test_a_death_that_is_not_the_episodes_fault_costs_nothing(clean: Path, tmp_path: Path) -> None:
    out, mark = tmp_path / "ds.zarr", tmp_path / "mark"
    once = f"Path({str(mark)!r}).exists() or (Path({str(mark)!r}).touch(), os._exit(9))"
    done = generate(out, {6: once})
    assert done.returncode == 0
    assert "a worker was lost in episode 6 (exit code 9); the block is made again" in done.stderr
    assert "quarantined" not in done.stdout
    assert_same_tree(clean, out)


def test_more_failures_than_allowed_are_exit_code_1_and_the_rest_is_there(tmp_path: Path) -> None:
    deeds = {i: "raise ValueError('no')" for i in range(4)}
    out = tmp_path / "ds.zarr"
    done = generate(out, deeds, "--max-failures", 0.3)
    assert done.returncode == 1
    assert "4 of 12 episodes are quarantined, more than --max-failures 0.3 allows" in done.stderr
    assert len(Dataset.open(out).committed) == 8
    again = generate(out, deeds, "--max-failures", 0.3)
    assert (again.returncode, len(Dataset.open(out).committed)) == (1, 8)
    assert generate(out, deeds, "--max-failures", 0.4).returncode == 0


def test_a_worker_that_dies_without_an_episode_in_hand_ends_the_run_after_some_tries(
    tmp_path: Path,
) -> None:
    out = tmp_path / "ds.zarr"
    place = tmp_path / "site"
    generate(out, {}, "--print-config")  # makes the place
    (place / "sitecustomize.py").write_text(
        "import os, sys\nif '--multiprocessing-fork' in sys.argv: os._exit(5)\n"
    )
    command = [sys.executable, "-m", "grasp_factory", "generate", "--n", "4", "--out", str(out)]
    done = subprocess.run(
        [*command, *TINY], env=os.environ | {"PYTHONPATH": f"{place}:{REPOSITORY}"},
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 1
    assert "3 workers were lost in block 0 (exit code 5)" in done.stderr.splitlines()[-1]
    assert "Traceback" not in done.stderr
