"""The contract of an executor.

- Results come in the order of the jobs, whichever is done first.
- Each message of a task arrives once, in its task's order.
- No jobs are no work.
- An error of the task, or of whoever hears a message, is raised as it is.
"""

from __future__ import annotations

import os
from functools import partial
from typing import Any

import pytest
from support import fake_blocks as blocks
from support.fake_cluster import FakeCluster

from grasp_factory.core.executors import (
    EXECUTORS,
    Executor,
    ExecutorSettings,
    InlineExecutor,
    LimitedExecutor,
    ProcessExecutor,
    SharingExecutor,
)
from grasp_factory.core.executors.cluster.coordinator import ClusterExecutor
from grasp_factory.errors import RecipeError

MADE: list[Executor] = [
    InlineExecutor(),
    ProcessExecutor(2),
    LimitedExecutor(2),
    SharingExecutor(2),
    ClusterExecutor(partial(FakeCluster, "a", "b"), 1),
]
if os.environ.get("GRASP_FACTORY_RAY") == "1":  # of bin/check-ray
    MADE.append(EXECUTORS["ray"].make(ExecutorSettings(workers=2)))
pytestmark = pytest.mark.timeout(60)


def ignore(_message: Any) -> None:
    pass


def test_every_executor_is_held_to_the_contract() -> None:
    classes = {cls.__name__ for cls in Executor.__subclasses__()}
    assert {type(executor).__name__ for executor in MADE} == classes


@pytest.mark.parametrize("executor", MADE, ids=lambda made: type(made).__name__)
class TestEveryExecutor:
    def test_results_come_in_the_order_of_the_blocks(self, executor: Executor) -> None:
        assert executor.run(blocks.square, [5, 1, 4], ignore) == [25, 1, 16]

    def test_every_message_arrives_once_and_in_its_blocks_order(self, executor: Executor) -> None:
        seen: list[tuple[int, int]] = []
        executor.run(blocks.square, [0, 1, 2], seen.append)
        assert sorted(seen) == [(block, step) for block in range(3) for step in range(3)]
        for block in range(3):
            assert [step for b, step in seen if b == block] == [0, 1, 2]

    def test_no_blocks_is_no_work(self, executor: Executor) -> None:
        assert executor.run(blocks.square, [], ignore) == []

    def test_an_error_of_the_task_is_raised_as_it_is(self, executor: Executor) -> None:
        with pytest.raises(RecipeError, match=r"^block 3 is impossible"):
            executor.run(blocks.user_error, [3], ignore)

    def test_an_error_of_the_listener_is_raised_as_it_is(self, executor: Executor) -> None:
        def refuse(message: Any) -> None:
            raise RecipeError(f"heard {message[0]}")

        with pytest.raises(RecipeError, match=r"^heard 3$"):
            executor.run(blocks.square, [3], refuse)


@pytest.mark.parametrize("name", EXECUTORS)
def test_every_kind_makes_an_executor(name: str) -> None:
    if name != "ray":  # which is not installed everywhere
        made = EXECUTORS[name].make(ExecutorSettings(workers=2))
        assert made.run(blocks.square, [3], ignore) == [9]
