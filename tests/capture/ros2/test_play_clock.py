"""Messages of a recording are sent when they are due."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from grasp_factory.capture.ros2.play_clock import PlayClock, PlayRate
from grasp_factory.errors import UsageError


class FakeClock:
    """A clock that only sleeping, and work, move on."""

    def __init__(self) -> None:
        self.now = 100.0

    def read(self) -> float:
        return self.now

    def sleep(self, seconds: float) -> None:
        assert seconds > 0
        self.now += seconds


def sent_at(stamps: list[int], rate: str, work_s: float = 0.0) -> tuple[list[float], float]:
    clock = FakeClock()
    player = PlayClock(PlayRate.parse(rate), clock=clock.read, sleep=clock.sleep)
    times = []
    for stamp in stamps:
        player.wait(stamp)
        times.append(clock.now - 100.0)
        clock.now += work_s
    return times, player.latest_s


@given(st.lists(st.integers(0, 10**11), min_size=1, max_size=30), st.sampled_from((0.5, 1, 2, 10)))
def test_a_message_is_sent_when_its_stamp_says_at_the_rate(stamps: list[int], rate: float) -> None:
    ordered = sorted(stamps)
    times, latest = sent_at(ordered, str(rate))
    due = [(stamp - ordered[0]) * 1e-9 / rate for stamp in ordered]
    assert times == pytest.approx(due, abs=1e-6)
    assert latest < 1e-6


def test_at_the_highest_rate_nothing_waits() -> None:
    assert sent_at([0, 10**9, 10**10], "max") == ([0.0, 0.0, 0.0], 0.0)


def test_what_is_sent_late_is_noted_and_does_not_delay_the_rest() -> None:
    times, latest = sent_at([0, 10**8, 2 * 10**8, 10**9], "1", work_s=0.25)
    assert times == pytest.approx([0.0, 0.25, 0.5, 1.0])
    assert latest == pytest.approx(0.3)


@pytest.mark.parametrize("text", ["0", "-1", "fast", "nan", "inf", "1e9", ""])
def test_a_rate_that_is_none_is_refused(text: str) -> None:
    with pytest.raises(UsageError, match=r"--rate: got .*valid: 0.001 to 1000, or max"):
        PlayRate.parse(text)
