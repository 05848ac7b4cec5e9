"""The coordinator and the agents of a cluster: nodes that are lost, refused, silent or late."""

from __future__ import annotations

import functools
import socket
from typing import Any

import pytest
from support import fake_blocks as blocks
from support.fake_cluster import FakeCluster

from grasp_factory.core.executors import LostNode, executor_kind
from grasp_factory.core.executors.cluster import coordinator
from grasp_factory.core.executors.cluster.coordinator import HEARTBEAT_S, ClusterExecutor
from grasp_factory.core.executors.cluster.ray_cluster import check_answers
from grasp_factory.core.executors.team import Report
from grasp_factory.errors import (
    ConfigError,
    StoreMismatchError,
    UnknownNameError,
    UsageError,
    WorkerError,
)

pytestmark = pytest.mark.timeout(120)


def ignore(_message: Any) -> None:
    pass


def refuse() -> None:
    raise StoreMismatchError("this node has numpy 1.0, not 2.0")


def break_down() -> None:
    raise ValueError("two\nlines")


def run(
    cluster: FakeCluster, jobs: Any, task: Any = blocks.square, **more: Any
) -> tuple[list[Any], list[str], list[tuple[int, str]]]:
    """Return the results of a run, what was said of nodes, and the losses."""
    said: list[str] = []
    lost: list[tuple[int, str]] = []

    def recover(job: int, why: str) -> int:
        lost.append((job, why))
        return job

    executor = ClusterExecutor(lambda: cluster, 1, said.append)
    return executor.run(task, jobs, ignore, recover, **more), said, lost


def test_all_nodes_work_and_say_so() -> None:
    results, said, lost = run(cluster := FakeCluster("a", "b"), range(6))
    assert results == [n * n for n in range(6)]
    assert len(said) == 2
    assert {line[: len("node a has 1 worker")] for line in said} == {
        "node a has 1 worker", "node b has 1 worker"
    }  # fmt: skip
    assert said[1].endswith("(2 nodes)")
    assert lost == []
    assert sorted(cluster.given["a"] + cluster.given["b"]) == list(range(6))


def test_a_node_that_is_gone_is_replaced_and_blames_the_node() -> None:
    cluster = FakeCluster("a", "b")

    def end_when_it_has_a_job(node: str, jobs: Any) -> None:
        if node == "a" and jobs and "a" not in cluster.silent:
            cluster.end("a", "its process died")

    cluster.on_ask = end_when_it_has_a_job
    results, said, lost = run(cluster, range(8))
    assert results == [n * n for n in range(8)]
    assert "node a is lost: its process died (1 node left)" in said
    ((_, why),) = lost
    assert isinstance(why, LostNode)
    assert why == "its node is lost: its process died"
    assert cluster.dropped == ["a"]


def test_a_node_that_does_not_answer_is_lost_and_what_it_says_later_is_not_heard() -> None:
    cluster = FakeCluster("a", "b")

    def hang(node: str, jobs: Any) -> None:
        if node == "a" and jobs:
            cluster.silent.add("a")
        if node == "b" and not jobs and "a" in cluster.silent:
            cluster.late_s += 4.0  # less than a suspension of this process
        if "a" in cluster.dropped:
            cluster.say("a", [Report("result", 0, "of a zombie")])

    cluster.on_ask = hang
    results, said, lost = run(cluster, [0, 1, 2])
    assert results == [0, 1, 4]
    assert f"node a is lost: did not answer for {HEARTBEAT_S:g} s (1 node left)" in said
    assert len(lost) == 1


def test_a_coordinator_that_was_suspended_loses_no_node() -> None:
    cluster = FakeCluster("a")

    def suspend(node: str, jobs: Any) -> None:
        cluster.late_s += 300.0 * bool(jobs)

    cluster.on_ask = suspend
    results, said, lost = run(cluster, [3, 4, 5])
    assert results == [9, 16, 25]
    assert lost == []
    assert len(said) == 1


def test_a_run_whose_nodes_are_all_lost_says_how_to_go_on() -> None:
    cluster = FakeCluster("a")
    cluster.on_ask = lambda node, jobs: cluster.end("a", "gone") if jobs else None
    with pytest.raises(WorkerError, match=r"^no node of the cluster is left; what is finished st"):
        run(cluster, [1])


@pytest.mark.parametrize(
    ("check", "text"),
    [(refuse, "this node has numpy 1.0, not 2.0"), (break_down, "ValueError: two lines")],
)
def test_a_node_that_must_not_work_is_refused_in_one_line(check: Any, text: str) -> None:
    with pytest.raises(UsageError) as caught:
        run(FakeCluster("a"), [1], check_node=check)
    assert str(caught.value) == text


class RefusesOnce:
    """A check that the first node to come fails."""

    def __init__(self, folder: str) -> None:
        self.mark = folder

    def __call__(self) -> None:
        import os

        try:
            os.close(os.open(self.mark, os.O_CREAT | os.O_EXCL))
        except FileExistsError:
            return
        refuse()


def test_the_other_nodes_do_the_part_of_one_that_is_refused(tmp_path: Any) -> None:
    check = RefusesOnce(str(tmp_path / "mark"))
    results, said, _ = run(FakeCluster("a", "b"), [1, 2], check_node=check)
    assert results == [1, 4]
    assert sum("is refused: this node has numpy" in line for line in said) == 1


def test_a_worker_that_is_lost_is_no_lost_node() -> None:
    lost: list[str] = []

    def recover(job: int, why: str) -> int:
        lost.append(why)
        return job + 100

    executor = ClusterExecutor(functools.partial(FakeCluster, "a"), 1)
    assert executor.run(blocks.dies_in_block_two, [2], ignore, recover) == [102]
    assert lost == ["SIGKILL"]
    assert not isinstance(lost[0], LostNode)


def test_the_constants_of_the_heartbeat_fit_each_other() -> None:
    from grasp_factory.core.executors.cluster import agent

    assert 10 * agent.BATCH_S <= coordinator.HEARTBEAT_S < agent.ALONE_S


@pytest.mark.parametrize(
    ("text", "error", "message"),
    [
        ("rai", UnknownNameError, "unknown executor 'rai'; did you mean 'ray'? (valid: inline, "),
        ("local:here", ConfigError, "executor: got 'local:here', valid: local"),
        ("ray:", ConfigError, "executor: got 'ray:', valid: ray:ADDRESS"),
    ],
)
def test_a_name_that_is_none_is_refused(text: str, error: Any, message: str) -> None:
    with pytest.raises(error) as caught:
        executor_kind(text)
    assert message[:20] in str(caught.value)


def test_an_address_where_nobody_is_ends_at_once() -> None:
    with socket.create_server(("127.0.0.1", 0)) as server:
        address = f"127.0.0.1:{server.getsockname()[1]}"
        check_answers(address)
    for name in ("", "auto"):  # Ray finds these itself
        check_answers(name)
    with pytest.raises(ConnectionRefusedError):
        check_answers(address)
