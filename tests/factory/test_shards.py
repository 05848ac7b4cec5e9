"""Parts of one store, made by runs that know nothing of each other but their locks."""

from __future__ import annotations

import dataclasses
import os
import socket
import subprocess
import sys
import threading
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from support.fake_episodes import make_episode, small_config
from support.helpers import assert_same_tree
from support.scale import scaled, soak_only

from grasp_factory.core.config.factory_config import FactoryConfig
from grasp_factory.dataset.dataset import Dataset
from grasp_factory.errors import ConfigError, StoreBusyError
from grasp_factory.factory import block_job, block_maker
from grasp_factory.factory.generate import generate
from grasp_factory.factory.run_records import RunPlan
from grasp_factory.factory.run_request import Request, Shard
from grasp_factory.writers.zarr.lock import ShardLock, StoreLock

pytestmark = pytest.mark.slow

CONFIG = small_config()  # blocks of 4


def pretend(world: Any, spec: Any) -> Any:
    """Return an episode that follows from its recipe, without physics."""
    return dataclasses.replace(make_episode(CONFIG, spec.index), spec=spec)


@pytest.fixture
def fake(monkeypatch: pytest.MonkeyPatch) -> None:
    """Replace the simulation; only for runs in this process."""
    monkeypatch.setattr(block_maker, "run_episode", pretend)


@pytest.fixture(scope="module")
def want(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the store of one run for 26 episodes."""
    path = tmp_path_factory.mktemp("want") / "want"
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(block_maker, "run_episode", pretend)
        generate(CONFIG, 26, path, workers=1)
    return path


@given(st.integers(1, 60), st.integers(0, 400))
def test_each_block_is_in_exactly_one_part(count: int, block: int) -> None:
    assert sum(Shard(i, count).has(block) for i in range(count)) == 1


@given(st.integers(1, 60), st.integers(0, 400))
def test_arrays_may_count_from_0_or_from_1(count: int, block: int) -> None:
    assert Shard(0, count).has(block) == Shard(count, count).has(block)


@pytest.mark.parametrize("text", ["", "1", "1/0", "3/2", "-1/2", "1/2/3", "a/b", "1/10001", "1 /2"])
def test_a_part_that_is_none_is_refused(text: str) -> None:
    with pytest.raises(ConfigError, match="shard: got"):
        Shard.parse(text)


@given(st.integers(1, 50), st.integers(1, 9))
def test_the_parts_of_a_request_are_disjoint_and_are_all(n: int, count: int) -> None:
    parts = [
        block_job.shard_rows(Request(config=CONFIG, n=n, shard=Shard(i, count)))
        for i in range(count)
    ]
    assert sorted(row for part in parts for row in part.tolist()) == list(range(n))


@pytest.mark.usefixtures("fake")
class TestParts:
    @pytest.mark.parametrize("order", [(2, 0, 1), *soak_only((0, 1, 2))])
    def test_in_any_order_give_the_bytes_of_one_run(
        self, tmp_path: Path, want: Path, order: tuple[int, ...]
    ) -> None:
        for index in order:
            summary = generate(CONFIG, 26, tmp_path / "out", workers=1, shard=Shard(index, 3))
        assert_same_tree(want, tmp_path / "out")
        assert (summary.asked, summary.made, summary.already_there) == (8, 8, 0)

    def test_may_be_split_otherwise_the_next_time(self, tmp_path: Path, want: Path) -> None:
        generate(CONFIG, 26, tmp_path / "out", workers=1, shard=Shard(1, 2))
        for index in range(3):
            generate(CONFIG, 26, tmp_path / "out", workers=1, shard=Shard(index, 3))
        assert_same_tree(want, tmp_path / "out")

    def test_grow_the_store_when_no_other_is_at_work(self, tmp_path: Path, want: Path) -> None:
        for n in (10, 26):
            for index in range(2):
                generate(CONFIG, n, tmp_path / "out", workers=1, shard=Shard(index, 2))
        assert_same_tree(want, tmp_path / "out")

    def test_do_not_grow_it_under_others(self, tmp_path: Path) -> None:
        generate(CONFIG, 10, tmp_path / "out", workers=1)
        with ShardLock(tmp_path / "out", 0, 2) as other:
            other.share()
            with pytest.raises(StoreBusyError, match="room for 10 episodes, and cannot grow to 26"):
                generate(CONFIG, 26, tmp_path / "out", workers=1, shard=Shard(1, 2))
        assert len(Dataset(tmp_path / "out")) == 10

    def test_leave_nothing_beside_the_store(self, tmp_path: Path) -> None:
        for index in range(2):
            generate(CONFIG, 10, tmp_path / "out", workers=1, shard=Shard(index, 2))
        assert {path.name for path in tmp_path.iterdir()} == {"out", "out.runs.jsonl"}

    def test_a_run_says_which_part_it_makes(self, tmp_path: Path) -> None:
        plans: list[RunPlan] = []
        generate(CONFIG, 10, tmp_path / "out", 1, shard=Shard(1, 2), on_start=plans.append)
        assert (plans[0].blocks, plans[0].to_make) == ((1,), 4)


class TestTheirLocks:
    def test_the_same_part_is_had_once(self, tmp_path: Path) -> None:
        who = f"process {os.getpid()} on {socket.gethostname()}"
        with ShardLock(tmp_path / "out", 0, 2) as first:
            first.share()
            with pytest.raises(StoreBusyError, match=who), ShardLock(tmp_path / "out", 0, 2):
                pass
            with ShardLock(tmp_path / "out", 1, 2) as second:
                assert not second.is_alone
        assert list(tmp_path.iterdir()) == []

    def test_parts_of_another_number_and_the_whole_are_refused(self, tmp_path: Path) -> None:
        who = rf"runs with --shard I/2 \(process {os.getpid()} on {socket.gethostname()}\)"
        with ShardLock(tmp_path / "out", 0, 2) as first:
            first.share()
            for other in (ShardLock(tmp_path / "out", 1, 3), StoreLock(tmp_path / "out")):
                with pytest.raises(StoreBusyError, match=who), other:
                    pass
        with StoreLock(tmp_path / "out"):
            with pytest.raises(StoreBusyError, match=f"process {os.getpid()}"):
                ShardLock(tmp_path / "out", 1, 3).__enter__()
        assert list(tmp_path.iterdir()) == []

    def test_a_part_waits_while_another_creates_the_store(self, tmp_path: Path) -> None:
        entered = threading.Event()
        seen: list[bool] = []

        def second() -> None:
            with ShardLock(tmp_path / "out", 1, 2) as lock:
                seen.append(lock.is_alone)
                entered.set()

        with ShardLock(tmp_path / "out", 0, 2) as first:
            assert first.is_alone
            thread = threading.Thread(target=second)
            thread.start()
            assert not entered.wait(0.5)
            first.share()
            assert entered.wait(10)
            assert seen == [False]
            thread.join()
            assert first.try_alone()

    def test_what_killed_parts_left_goes_with_the_next_that_is_alone(self, tmp_path: Path) -> None:
        left = tmp_path / ".out.grasp-factory.shard-0-of-2.lock"
        left.write_text("host 1\n")
        with ShardLock(tmp_path / "out", 1, 2) as lock:
            lock.share()
            with pytest.raises(StoreBusyError) as caught:
                StoreLock(tmp_path / "out").__enter__()
            assert f"(process {os.getpid()} on {socket.gethostname()})" in str(caught.value)
        left.write_text("host 1\n")
        with StoreLock(tmp_path / "out"):
            assert not left.exists()
        assert list(tmp_path.iterdir()) == []

    def test_only_the_last_is_alone_at_the_end(self, tmp_path: Path) -> None:
        with ShardLock(tmp_path / "out", 0, 2) as first:
            first.share()
            with ShardLock(tmp_path / "out", 1, 2) as second:
                assert not second.try_alone()
            assert first.try_alone()


@pytest.mark.soak
@pytest.mark.timeout(180)
def test_parts_that_are_made_at_the_same_time_give_the_bytes_of_one_run(tmp_path: Path) -> None:
    def start(*args: str) -> subprocess.Popen[str]:
        command = [sys.executable, "-m", "grasp_factory", "generate", "--n", "12", "--seed", "3",
                   "--workers", "1", "--resolution", "48x36", "--set", "block_size=2",
                   "--out", str(tmp_path / "out"), *args]  # fmt: skip
        return subprocess.Popen(
            command, text=True, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE
        )

    parts = scaled(2, 3)
    runs = [start("--shard", f"{i + 1}/{parts}") for i in range(parts)]
    for run in runs:
        _, said = run.communicate()
        assert run.returncode == 0, said
    assert {path.name for path in tmp_path.iterdir()} == {"out", "out.runs.jsonl"}
    config = FactoryConfig(seed=3, resolution=(48, 36), block_size=2)
    generate(config, 12, tmp_path / "want", workers=1)
    assert_same_tree(tmp_path / "want", tmp_path / "out")
