"""A device's clock on the host's: batches, drift, jumps and wraps."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from support.clocks import batched, device_times
from support.scale import scaled

from grasp_factory.capture.clocks.clock_fit import fit_clock
from grasp_factory.capture.clocks.clock_rule import ClockRule
from grasp_factory.capture.clocks.clock_tracker import ClockTracker
from grasp_factory.errors import ConfigError, UsageError

Ticks = NDArray[np.int64]
MS = 1_000_000


def errors_ms(fitted: Ticks, truth: Ticks) -> NDArray[np.float64]:
    """Return errors without the constant delay of the fastest sample, milliseconds."""
    error = (fitted - truth) / MS
    return np.asarray(error - np.median(error))


class TestOneClock:
    def test_batches_of_16_ms_are_undone_under_a_drift_of_50_ppm(self) -> None:
        truth, host = batched(seconds=60.0, rate_hz=400.0, batch_s=0.016, seed=1)
        fit = fit_clock(device_times(truth, drift_ppm=50.0), host)
        assert np.abs((host - truth) / MS).max() > 15.0
        assert np.abs(errors_ms(fit.host_ns, truth)).max() < 0.3
        assert fit.report().drift_ppm == pytest.approx(-50.0, abs=10.0)

    def test_no_sample_was_taken_after_it_had_arrived(self) -> None:
        truth, host = batched(seconds=30.0, rate_hz=200.0, batch_s=0.016, seed=2)
        fit = fit_clock(device_times(truth, drift_ppm=-120.0), host)
        assert fit.delays_ns.min() >= -0.1 * MS

    def test_a_clock_whose_drift_changes_is_followed(self) -> None:
        truth, host = batched(seconds=400.0, rate_hz=100.0, batch_s=0.016, seed=3)
        seconds = truth / 1e9
        wander = 0.5 * 0.2e-6 * seconds**2  # 0.2 ppm more each second
        fit = fit_clock((truth + wander * 1e9).astype(np.int64), host)
        assert np.abs(errors_ms(fit.host_ns, truth)).max() < 0.6
        whole = fit_clock((truth + wander * 1e9).astype(np.int64), host,
                          ClockRule(window_s=4000.0))  # fmt: skip
        assert np.abs(errors_ms(whole.host_ns, truth)).max() > 2.0

    def test_a_known_latency_is_taken_off(self) -> None:
        truth, host = batched(seconds=5.0, rate_hz=100.0, batch_s=0.01, seed=4)
        plain = fit_clock(truth, host)
        earlier = fit_clock(truth, host, ClockRule(latency_s=0.002))
        assert set((plain.host_ns - earlier.host_ns).tolist()) == {2 * MS}

    def test_the_raw_times_are_left_as_they_were(self) -> None:
        truth, host = batched(seconds=1.0, rate_hz=100.0, batch_s=0.01, seed=5)
        device = device_times(truth, drift_ppm=50.0)
        before = device.copy(), host.copy()
        fit_clock(device, host)
        assert np.array_equal(device, before[0])
        assert np.array_equal(host, before[1])


class TestJumps:
    @pytest.mark.parametrize("jump_s", [-3.0, -0.03, 0.05, 7.0])
    def test_a_jump_starts_a_piece_at_its_sample(self, jump_s: float) -> None:
        truth, host = batched(seconds=60.0, rate_hz=400.0, batch_s=0.016, seed=6)
        device = device_times(truth, drift_ppm=50.0)
        device[9000:] += round(jump_s * 1e9)
        fit = fit_clock(device, host)
        assert [piece.start.index for piece in fit.pieces] == [0, 9000]
        assert np.abs(errors_ms(fit.host_ns, truth)).max() < 0.6

    def test_a_counter_of_24_bits_wraps_into_pieces_on_one_clock(self) -> None:
        truth, host = batched(seconds=60.0, rate_hz=400.0, batch_s=0.016, seed=7)
        ticks = truth // 1000 % 2**24  # microseconds, every 16.8 s
        fit = fit_clock(ticks * 1000, host)
        assert fit.report().starts == ("first_sample", *["backward"] * 3)
        assert np.abs(errors_ms(fit.host_ns, truth)).max() < 1.0

    def test_a_busy_host_is_no_jump(self) -> None:
        truth, host = batched(seconds=60.0, rate_hz=400.0, batch_s=0.016, seed=8)
        late = (truth > 20e9) & (truth < 23e9)
        host = np.maximum.accumulate(np.where(late, host + 80 * MS, host))
        fit = fit_clock(truth, host)
        assert len(fit.pieces) == 1
        assert np.abs(errors_ms(fit.host_ns, truth)).max() < 0.3

    def test_a_clock_that_pauses_is_found_where_it_paused(self) -> None:
        truth, host = batched(seconds=60.0, rate_hz=400.0, batch_s=0.016, seed=9)
        device = truth.copy()
        device[8000:8041] = device[8000]
        device[8041:] -= device[8041] - device[8000]
        fit = fit_clock(device, host)
        assert fit.report().starts == ("first_sample", "behind")
        assert abs(fit.pieces[1].start.index - 8000) < 60

    def test_an_unplugged_device_that_comes_back_is_on_the_clock_again(self) -> None:
        truth, host = batched(seconds=60.0, rate_hz=400.0, batch_s=0.016, seed=10)
        gone = (truth > 20e9) & (truth < 40e9)
        truth, host = truth[~gone], host[~gone]
        fit = fit_clock(device_times(truth, drift_ppm=50.0), host)
        assert np.abs(errors_ms(fit.host_ns, truth)).max() < 0.6

    @settings(max_examples=scaled(10, 300), deadline=None)
    @given(
        drift=st.floats(-300.0, 300.0),
        jumps=st.lists(st.tuples(st.integers(1, 29), st.floats(-50.0, 50.0)), max_size=3),
        seed=st.integers(0, 1000),
    )
    def test_whatever_the_clock_does_the_fit_is_near_the_truth(
        self, drift: float, jumps: list[tuple[int, float]], seed: int
    ) -> None:
        truth, host = batched(seconds=30.0, rate_hz=100.0, batch_s=0.016, seed=seed)
        device = device_times(truth, drift_ppm=drift)
        for second, jump in jumps:
            device[truth >= second * 1e9] += round(jump * 1e9)
        fit = fit_clock(device, host)
        error = (fit.host_ns - truth) / MS
        assert sum(piece.count for piece in fit.pieces) == len(truth)
        # A jump below the smallest that counts, and a piece of a second, may cost a batch's length.
        assert np.abs(error).max() < 20.0 + 17.0 + 1.0


class TestTracker:
    def test_it_is_near_the_truth_after_some_seconds(self) -> None:
        truth, host = batched(seconds=60.0, rate_hz=200.0, batch_s=0.016, seed=11)
        device = device_times(truth, drift_ppm=50.0)
        tracker = ClockTracker()
        pairs = zip(device.tolist(), host.tolist(), strict=True)
        found = np.array([tracker.add(*pair) for pair in pairs])
        late = errors_ms(found, truth)[truth > 35e9]
        assert np.abs(late - np.median(late)).max() < 0.6
        assert tracker.drift_ppm == pytest.approx(-50.0, abs=25.0)
        assert tracker.pieces == 1

    def test_a_jump_starts_a_piece(self) -> None:
        tracker = ClockTracker()
        for k in range(10):
            tracker.add(k * 10 * MS, k * 10 * MS)
        assert tracker.add(10_000 * MS, 100 * MS) == 100 * MS
        assert tracker.pieces == 2


class TestErrors:
    def test_no_samples_are_refused(self) -> None:
        with pytest.raises(UsageError, match="got 0 and 0 times"):
            fit_clock(np.empty(0, np.int64), np.empty(0, np.int64))

    def test_a_host_clock_that_goes_back_is_refused(self) -> None:
        with pytest.raises(UsageError, match="descends after sample 1"):
            fit_clock([1, 2, 3], [5, 6, 4])

    def test_seconds_are_refused(self) -> None:
        with pytest.raises(UsageError, match="whole nanoseconds"):
            fit_clock([0.1, 0.2], [1, 2])

    def test_a_setting_out_of_range_is_named(self) -> None:
        with pytest.raises(ConfigError, match=r"jump_s: got 0\.0"):
            ClockRule(jump_s=0.0)
