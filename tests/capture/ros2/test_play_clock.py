"""Messages of a recording are sent when they are due."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from grasp_factory.capture.ros2.clock_topic import ClockTicks, clock_message
from grasp_factory.capture.ros2.play_clock import PlayClock, PlayRate
from grasp_factory.errors import CaptureError, UsageError


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


def test_a_message_that_is_due_in_years_is_refused() -> None:
    clock = PlayClock(
        PlayRate(factor=1e-3), clock=lambda: 0.0, sleep=lambda s: pytest.fail("slept")
    )
    clock.wait(1)
    with pytest.raises(CaptureError, match=r"due in .* days: publish with --rate max"):
        clock.wait(2**63 - 1)


@pytest.mark.parametrize("stamp_ns", [-1, 2**31 * 10**9, 2**63 - 1])
def test_a_time_that_the_clocks_type_has_no_room_for_is_refused(stamp_ns: int) -> None:
    with pytest.raises(CaptureError, match="valid for /clock: 0 to 2147483647 s"):
        clock_message(stamp_ns)
    assert clock_message((2**31 - 1) * 10**9 + 999_999_999)


def test_times_of_the_clock_come_every_10_ms_from_the_first_message_on() -> None:
    ticks = ClockTicks(skips_pauses=False)
    found = [list(ticks.until(stamp)) for stamp in (5_000_000, 5_000_000, 36_000_000, 40_000_000)]
    assert found == [[5_000_000], [], [15_000_000, 25_000_000, 35_000_000], []]


def test_a_pause_of_years_has_one_time_if_nothing_waits() -> None:
    ticks = ClockTicks(skips_pauses=True)
    assert list(ticks.until(0)) == [0]
    assert list(ticks.until(2**62)) == [2**62 // 10**7 * 10**7]
    assert list(ticks.until(2**62)) == []


@pytest.mark.parametrize("text", ["0", "-1", "fast", "nan", "inf", "1e9", ""])
def test_a_rate_that_is_none_is_refused(text: str) -> None:
    with pytest.raises(UsageError, match=r"--rate: got .*valid: 0.001 to 1000, or max"):
        PlayRate.parse(text)
