"""Missing messages are counted by the stamps alone."""

from __future__ import annotations

import math

from hypothesis import given
from hypothesis import strategies as st

from grasp_factory.capture.ros2.stream_gaps import GapCount, StreamGaps

RATES = st.sampled_from((15.0, 30.0, 100.0, 120.0, 400.0, 1000.0))


def counted(stamps: list[int]) -> GapCount:
    gaps = StreamGaps()
    for stamp in stamps:
        gaps.add(stamp)
    return gaps.counted()


@given(RATES, st.integers(20, 400), st.sets(st.integers(1, 398), max_size=6))
def test_each_message_that_is_left_out_of_a_steady_stream_is_counted(
    rate: float, length: int, left_out: set[int]
) -> None:
    inner = {k for k in left_out if k < length - 1}
    stamps = [round(k * 1e9 / rate) for k in range(length) if k not in inner]
    found = counted(stamps)
    assert (found.missing, found.count) == (len(inner), length - len(inner))
    assert math.isclose(found.period_ns, 1e9 / rate, rel_tol=1e-3)


@given(RATES, st.integers(21, 5000))
def test_a_long_gap_is_counted_to_the_message(rate: float, gap: int) -> None:
    numbers = [*range(300), *range(300 + gap, 600 + gap)]
    found = counted([round(k * 1e9 / rate) for k in numbers])
    assert found.missing == gap
    assert found.longest_ns >= (gap + 1) * 1e9 / rate - 1


@given(st.lists(st.floats(-0.2, 0.2), min_size=50, max_size=200), st.integers(10, 40))
def test_jitter_of_a_fifth_of_a_period_hides_no_loss(jitter: list[float], left_out: int) -> None:
    period = 2_500_000
    stamps = [round((k + off) * period) for k, off in enumerate(jitter) if k != left_out]
    assert counted(stamps).missing == 1


def test_stamps_that_go_back_or_stay_are_counted_and_are_no_gap() -> None:
    found = counted([0, 10, 20, 20, 15, 25, 35])
    assert (found.backward, found.missing, found.longest_ns) == (2, 0, 10)


@given(st.lists(st.integers(0, 2**62), max_size=30))
def test_any_stamps_can_be_counted(stamps: list[int]) -> None:
    found = counted(stamps)
    assert found.count == len(stamps)
    assert found.missing >= 0


def test_one_message_has_no_rate() -> None:
    found = counted([5])
    assert math.isnan(found.period_ns)
    assert math.isnan(found.mean_ns)
    assert found.missing == found.longest_ns == 0
