"""What a lost worker costs: the bookkeeping, without processes."""

from __future__ import annotations

import math

import pytest

from grasp_factory.core.executors import LostNode
from grasp_factory.errors import FailuresError, WorkerError
from grasp_factory.factory.block_job import Begun, BlockJob, Committed, Made
from grasp_factory.factory.retry_policy import FEWEST_FAILURES, Failures, Losses


def made(index: int, outcome: str = "success") -> Made:
    return Made(index=index, policy="uniform", outcome=outcome, reason="why")


@pytest.fixture
def said() -> list[str]:
    return []


@pytest.fixture
def losses(said: list[str]) -> Losses:
    return Losses(4, 60.0, said.append)


def test_each_episode_is_news_once_however_often_its_block_is_made(losses: Losses) -> None:
    job = BlockJob(block=1)
    first = [losses.news(m) for m in (Begun(index=4), made(4), Begun(index=5))]
    assert first == [None, made(4), None]
    job = losses.recover(job, "SIGKILL")
    again = [losses.news(m) for m in (Begun(index=4), made(4), Begun(index=5), made(5))]
    assert again == [None, None, None, made(5)]
    assert losses.news(Committed(block=1)) is None


def test_the_episode_in_hand_is_tried_once_more_and_then_given_up(
    losses: Losses, said: list[str]
) -> None:
    job = BlockJob(block=0)
    losses.news(Begun(index=2))
    assert losses.recover(job, "SIGSEGV") == job
    losses.news(Begun(index=2))
    job = losses.recover(job, "SIGSEGV")
    assert job == BlockJob(block=0, lost={2: "its worker was lost twice (SIGSEGV)"})
    losses.news(Begun(index=3))
    losses.recover(job, "SIGSEGV")
    losses.news(Begun(index=3))
    assert set(losses.recover(job, "SIGSEGV").lost) == {2, 3}
    assert said == [
        "a worker was lost in episode 2 (SIGSEGV); the block is made again",
        "a worker was lost in episode 3 (SIGSEGV); the block is made again",
    ]


def test_a_death_between_episodes_blames_none_and_the_third_ends_the_run(losses: Losses) -> None:
    job = BlockJob(block=0)
    for _ in range(2):
        losses.news(Begun(index=3))
        losses.news(made(3))
        assert losses.recover(job, "SIGKILL") == job
    with pytest.raises(WorkerError, match=r"3 workers were lost in block 0 \(SIGKILL\)"):
        losses.recover(job, "SIGKILL")


def test_a_lost_node_blames_no_episode_and_the_third_loss_of_a_block_ends_the_run(
    losses: Losses,
) -> None:
    job, why = BlockJob(block=0), LostNode("its node is lost: did not answer")
    for _ in range(2):
        losses.news(Begun(index=3))
        assert losses.recover(job, why) == job
    losses.news(Begun(index=3))
    with pytest.raises(WorkerError, match="3 workers were lost in block 0"):
        losses.recover(job, why)


def test_an_episode_that_is_given_up_cannot_go_on_killing(losses: Losses) -> None:
    job = BlockJob(block=0, lost={1: "no more"})
    with pytest.raises(WorkerError):
        for _ in range(4):
            losses.news(Begun(index=1))
            assert losses.recover(job, "SIGSEGV") == job


def test_only_an_episode_has_the_timeout(losses: Losses) -> None:
    assert losses.silence(Begun(index=0)) == 60.0
    assert losses.silence(None) == losses.silence(made(0)) == 600.0
    assert Losses(4, math.inf, print).silence(None) == math.inf


def test_few_failures_stop_no_run_and_too_many_do() -> None:
    failures = Failures(0.1, 1000)
    for i in range(100):
        failures.count(made(i, "quarantined"))
        failures.count(made(i))
    with pytest.raises(FailuresError, match="101 episodes of this run are quarantined"):
        failures.count(made(200, "quarantined"))
    failures = Failures(0.0, 1000)
    for i in range(FEWEST_FAILURES):
        failures.count(made(i, "quarantined"))
