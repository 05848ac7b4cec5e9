"""Episodes that kill, hang or break their worker: only they are quarantined."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import pytest
from support.helpers import assert_same_tree
from support.places import REPOSITORY
from support.sabotage import SABOTAGE
from support.scale import IS_SOAK, scaled, soak_only

from grasp_factory.core.config.factory_config import FactoryConfig
from grasp_factory.dataset.dataset import Dataset
from grasp_factory.factory import generate as factory
from grasp_factory.sampling.spec import sample_spec

pytestmark = [pytest.mark.slow, pytest.mark.timeout(240)]
N = 12
TINY = ("--seed", "3", "--resolution", "48x36", "--set", "block_size=4")


def sabotaged(folder: Path, text: str) -> dict[str, str]:
    """Write code that processes run as they start; return the environment for that."""
    place = folder / "site"
    place.mkdir(exist_ok=True)
    (place / "sitecustomize.py").write_text(text)
    return os.environ | {"PYTHONPATH": f"{place}:{REPOSITORY}"}


def generate(
    out: Path, deeds: Mapping[int, str], *args: Any, workers: int = 2
) -> subprocess.CompletedProcess[str]:
    """Run the command; a worker does the deed of an episode before it makes it."""
    lines = [f"if spec.index == {i}: {deed}" for i, deed in deeds.items()]
    command = [sys.executable, "-m", "grasp_factory", "generate", "--n", N, "--out", out]
    return subprocess.run(
        [str(word) for word in (*command, "--workers", workers, *TINY, *args)],
        env=sabotaged(out.parent, SABOTAGE.format(deeds="\n        ".join(lines))),
        capture_output=True,
        check=False,
        text=True,
    )


@pytest.fixture(scope="module")
def clean(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("clean") / "ds.zarr"
    factory.generate(FactoryConfig(seed=3, resolution=(48, 36), block_size=4), N, path, workers=1)
    return path


def checksums(path: Path) -> dict[int, str]:
    dataset = Dataset(path)
    column = dataset.column("checksum")
    return {int(i): column[i] for i in dataset.committed}


KINDS = {
    "os.kill(os.getpid(), signal.SIGSEGV)": "its worker was lost twice (SIGSEGV)",
    "os.kill(os.getpid(), signal.SIGKILL)": "its worker was lost twice (SIGKILL)",
    "os._exit(3)": "its worker was lost twice (exit code 3)",
    "raise MemoryError": "its worker was lost twice (SIGKILL)",
    "raise ValueError('two\\nlines')": "ValueError: two lines",
    "time.sleep(1e6)": "its worker was lost twice (silent for more than 8 s)",
    "os.kill(os.getpid(), signal.SIGSTOP)": "its worker was lost twice (silent for more than 8 s)",
}
"""Deed to the reason that is told."""
TOGETHER = {
    1: "time.sleep(1e6)",  # while the other worker makes the other blocks
    5: "os.kill(os.getpid(), signal.SIGSEGV)",
    9: "raise MemoryError",
    11: "raise ValueError('two\\nlines')",
}


@pytest.mark.parametrize(
    "deeds",
    [TOGETHER, *soak_only(*({5: deed} for deed in KINDS))],
    ids=["together", *KINDS],
)
def test_an_episode_that_cannot_be_made_is_quarantined_alone(
    clean: Path, tmp_path: Path, deeds: dict[int, str]
) -> None:
    out = tmp_path / "ds.zarr"
    done = generate(out, deeds, "--episode-timeout", 8, "--max-failures", 0.5, "--json")
    assert done.returncode == 0, done.stderr
    summary, want = json.loads(done.stdout), checksums(clean)
    assert list(summary["quarantined"]) == [str(i) for i in deeds]
    config = FactoryConfig.from_plain(Dataset(out).attributes["config"])
    for i, deed in deeds.items():
        assert f"episode {i} is quarantined: {KINDS[deed]}\n" in done.stderr
        assert summary["quarantined"][str(i)] == KINDS[deed]
        assert Dataset(out).spec(i) == sample_spec(config, i)
        del want[i]
    assert checksums(out) == want


@pytest.mark.soak
def test_deaths_give_the_same_bytes_for_any_number_of_workers(tmp_path: Path) -> None:
    deeds = {5: "raise ValueError('no')", 6: "os._exit(3)"}
    if IS_SOAK:
        deeds[0] = "os._exit(3)"
    numbers = (1, 2, *((3,) if IS_SOAK else ()))
    more = ("--n", scaled(8, N), "--max-failures", 0.5)
    stores = [tmp_path / f"{workers}.zarr" for workers in numbers]
    for workers, out in zip(numbers, stores, strict=True):
        done = generate(out, deeds, *more, workers=workers)
        assert done.returncode == 0
        assert f"episode 6 is quarantined: {KINDS['os._exit(3)']}\n" in done.stderr
    for out in stores[1:]:
        assert_same_tree(stores[0], out)


@pytest.mark.soak
def test_a_death_that_is_not_the_episodes_fault_costs_nothing(clean: Path, tmp_path: Path) -> None:
    out, mark = tmp_path / "ds.zarr", tmp_path / "mark"
    once = f"Path({str(mark)!r}).exists() or (Path({str(mark)!r}).touch(), os._exit(9))"
    done = generate(out, {6: once})
    assert done.returncode == 0
    assert "a worker was lost in episode 6 (exit code 9); the block is made again" in done.stderr
    assert "quarantined" not in done.stdout
    assert_same_tree(clean, out)


@pytest.mark.soak
def test_more_failures_than_allowed_are_exit_code_1_and_the_rest_is_there(
    tmp_path: Path, run: Callable[..., tuple[int, str, str]]
) -> None:
    deeds = {i: "raise ValueError('no')" for i in range(4)}
    out = tmp_path / "ds.zarr"
    done = generate(out, deeds, "--max-failures", 0.3)
    assert done.returncode == 1
    assert "4 of 12 episodes are quarantined, more than --max-failures 0.3 allows" in done.stderr
    assert len(Dataset(out).committed) == 8
    again = ("generate", "--n", N, "--out", out, *TINY, "--max-failures")
    code, _, _ = run(*again, 0.3)  # without deeds: what is quarantined is not made again
    assert (code, len(Dataset(out).committed)) == (1, 8)
    assert run(*again, 0.4)[0] == 0


def test_a_worker_that_dies_without_an_episode_in_hand_ends_the_run_after_some_tries(
    tmp_path: Path,
) -> None:
    dies = "import os, sys\nif '--multiprocessing-fork' in sys.argv: os._exit(5)\n"
    command = [sys.executable, "-m", "grasp_factory", "generate", "--n", "4"]
    done = subprocess.run(
        [*command, "--out", str(tmp_path / "ds.zarr"), *TINY], env=sabotaged(tmp_path, dies),
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 1
    assert "3 workers were lost in block 0 (exit code 5)" in done.stderr.splitlines()[-1]
    assert "Traceback" not in done.stderr
