"""Samples of several devices that belong together: queues, spreads, tolerances, interpolation."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support.scale import scaled

from grasp_factory.capture.sync.interpolation import gaps_around, interpolate
from grasp_factory.capture.sync.live_sets import LiveSets
from grasp_factory.capture.sync.queue_sizes import StreamTiming, queue_lengths
from grasp_factory.capture.sync.set_spread import synchronise
from grasp_factory.capture.sync.sync_settings import SyncMethod, SyncSettings
from grasp_factory.core.serialization import from_plain
from grasp_factory.errors import ConfigError, UsageError
from grasp_factory.signals.sample_sets import approximate_time

MS = 1_000_000
TIMINGS = {
    "camera": StreamTiming(rate_hz=30.0, latency_s=0.12),
    "imu": StreamTiming(rate_hz=400.0, latency_s=0.002),
}
LATENCIES = {name: timing.latency_s for name, timing in TIMINGS.items()}
RATES = {name: timing.rate_hz for name, timing in TIMINGS.items()}
STREAMS = {
    "camera": np.arange(0.0, 2.0, 1 / 30),
    "imu": np.arange(0.0, 2.0, 1 / 400) + 0.0004,
    "force": np.arange(0.0, 2.0, 1 / 1000),
}


def arrivals(latencies: Mapping[str, float], rates: Mapping[str, float], seconds: float = 5.0):
    """Return (arrival, name, time) in ns, in the order of arrival."""
    found = []
    for name, rate in rates.items():
        times = (np.arange(int(seconds * rate)) / rate * 1e9 + 1234567).astype(np.int64)
        found += [(int(t + latencies[name] * 1e9), name, int(t)) for t in times]
    return sorted(found)


def live(lengths: Mapping[str, int], samples, slop_ns: float = float("inf")):
    sets = LiveSets(lengths, slop_ns)
    return sets, [found for _, name, time in samples for found in sets.add(name, time)]


def spreads_ms(found) -> np.ndarray:
    return np.array([max(f.values()) - min(f.values()) for f in found]) / MS


class TestQueues:
    def test_an_image_that_is_120_ms_late_gets_the_imu_samples_of_its_time(self) -> None:
        sets, found = live(queue_lengths(TIMINGS), arrivals(LATENCIES, RATES))
        assert len(found) > 140
        assert spreads_ms(found).max() <= 1.26  # half of the IMU's period
        assert sets.dropped == {"camera": 0, "imu": 0}

    def test_a_queue_of_30_loses_the_images_partners_and_says_so(self) -> None:
        lengths = {"camera": 30, "imu": 30}
        sets, found = live(lengths, arrivals(LATENCIES, RATES), 100 * MS)
        assert len(found) < 15  # of 150 images
        assert sets.dropped["imu"] > 1000

    def test_the_length_follows_rate_and_latency(self) -> None:
        lengths = queue_lengths(TIMINGS, margin=1.0)
        assert lengths == {"camera": 4, "imu": 76}
        assert queue_lengths({"a": StreamTiming(rate_hz=10.0)}, margin=1.0) == {"a": 4}

    def test_no_streams_are_refused(self) -> None:
        with pytest.raises(UsageError, match="no streams"):
            queue_lengths({})

    def test_a_latency_out_of_range_is_refused(self) -> None:
        with pytest.raises(ConfigError, match=r"latency_s: got -1\.0"):
            StreamTiming(rate_hz=1.0, latency_s=-1.0)


TIMES = st.lists(st.integers(0, 300), min_size=0, max_size=25, unique=True).map(sorted)


class TestLiveSets:
    @settings(max_examples=scaled(60, 3000), deadline=None)
    @given(
        streams=st.dictionaries(st.sampled_from("abc"), TIMES, min_size=1),
        slop=st.one_of(st.just(float("inf")), st.integers(1, 40)),
        order=st.randoms(use_true_random=False),
    )
    def test_in_any_order_of_arrival_it_forms_the_sets_of_the_whole(
        self, streams: dict[str, list[int]], slop: float, order
    ) -> None:
        queues = {name: list(times) for name, times in streams.items()}
        samples = []
        while any(queues.values()):
            name = order.choice([n for n, q in queues.items() if q])
            samples.append((0, name, queues[name].pop(0) * MS))
        _, found = live(dict.fromkeys(streams, 1000), samples, slop * MS)
        seconds = {name: np.array(times) / 1000.0 for name, times in streams.items()}
        whole = approximate_time(seconds, slop / 1000.0)
        count = len(next(iter(whole.indices.values())))
        expected = [
            {name: streams[name][whole.indices[name][k]] * MS for name in streams}
            for k in range(count)
        ]
        assert found == expected[: len(found)]
        assert len(found) >= count - 1  # the last set waits for a sample that could change it

    def test_times_that_do_not_ascend_are_refused(self) -> None:
        sets = LiveSets({"a": 3, "b": 3})
        sets.add("a", 5)
        with pytest.raises(UsageError, match="5 ns follows 5 ns"):
            sets.add("a", 5)


class TestSpread:
    def test_every_pair_of_every_set_has_its_difference(self) -> None:
        found = synchronise(STREAMS, SyncSettings())
        assert list(found.differences) == ["camera-imu", "camera-force", "imu-force"]
        assert all(len(d) == 60 for d in found.differences.values())
        worst = np.abs(found.differences["camera-imu"]).max() * 1e3
        assert found.spreads[0].largest_ms == pytest.approx(worst)
        assert found.spreads[0].tolerance_ms is None
        assert found.missed == ()

    def test_sets_beyond_a_tolerance_are_counted(self) -> None:
        tolerances = {"imu-camera": 0.001, "camera-force": 0.004}
        found = synchronise(STREAMS, SyncSettings(tolerances_s=tolerances))
        (missed,) = found.missed
        beyond = int((np.abs(found.differences["camera-imu"]) > 0.001).sum())
        assert (missed.name, missed.beyond) == ("camera-imu", beyond)
        assert 0 < beyond < 60

    def test_a_tolerance_for_unknown_streams_is_refused(self) -> None:
        with pytest.raises(
            ConfigError, match=r"tolerances_s: got 'camera-imo', valid: camera-force, camera-imu"
        ):
            synchronise(STREAMS, SyncSettings(tolerances_s={"camera-imo": 0.001}))

    def test_streams_without_a_set_have_no_numbers(self) -> None:
        found = synchronise({"a": [0.0], "b": [5.0]}, SyncSettings(slop_s=0.1))
        assert found.spreads[0].sets == 0
        assert np.isnan(found.spreads[0].largest_ms)

    def test_the_settings_are_read_from_plain_data(self) -> None:
        plain = {"method": "interpolate", "reference": "camera", "tolerances_s": {"a-b": 0.001}}
        assert from_plain(SyncSettings, plain).method is SyncMethod.INTERPOLATE
        with pytest.raises(ConfigError, match="reference"):
            from_plain(SyncSettings, {"method": "interpolate"})


class TestInterpolation:
    def test_values_lie_at_the_reference_and_gaps_are_told(self) -> None:
        times = np.delete(np.arange(0.0, 1.0, 0.0025), np.arange(100, 140))
        at = np.arange(0.0, 1.2, 1 / 30)
        settings = SyncSettings(
            method=SyncMethod.INTERPOLATE, reference="camera", slop_s=0.01
        )  # fmt: skip
        found = interpolate({"imu": (times, np.sin(times))}, at, settings)["imu"]
        inside = found.matched
        assert np.abs(found.values[inside] - np.sin(at[inside])).max() < 1e-6
        assert not inside[(at > 0.26) & (at < 0.34)].any()
        assert np.isnan(found.values[~inside]).all()
        assert np.nanmax(found.gaps) == pytest.approx(0.1025)

    def test_outside_and_at_a_sample(self) -> None:
        assert np.array_equal(
            gaps_around([1.0, 2.0], [0.5, 1.0, 1.5, 2.0, 2.5]),
            [np.nan, 0.0, 1.0, 0.0, np.nan],
            equal_nan=True,
        )
        assert np.isnan(gaps_around([], [1.0])).all()
