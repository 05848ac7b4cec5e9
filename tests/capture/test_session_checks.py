"""The live checks: each finds its fault, and nothing else, in windows of statistics."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from grasp_factory.capture.devices.base import DeviceCounters
from grasp_factory.capture.samples import (
    CameraFrame,
    DeviceKind,
    InertialReading,
    Payload,
    Sample,
    WrenchReading,
)
from grasp_factory.capture.session.checks import (
    CHECKS,
    START_S,
    DiskWindow,
    disk_finding,
    drift_ppm,
    queue_findings,
    stream_findings,
)
from grasp_factory.capture.session.session_config import DeviceConfig
from grasp_factory.capture.session.stream_statistics import (
    Bucket,
    StreamStatistics,
    StreamWindow,
    rate_hz,
)
from grasp_factory.capture.session.tolerances import Tolerances
from grasp_factory.errors import ConfigError

S = 10**9
LIMITS = Tolerances()


def bucket(second: int, **more: Any) -> Bucket:
    usual = {"samples": 100, "longest_gap_ns": S // 100, "least_offset_ns": 7 * S}
    return Bucket(**{**usual, "start_ns": second * S, "end_ns": (second + 1) * S, **more})


def window(*buckets: Bucket, **more: Any) -> StreamWindow:
    usual = {
        "device": "imu",
        "kind": DeviceKind.IMU,
        "expected_hz": 100.0,
        "buckets": buckets or tuple(bucket(k) for k in range(30)),
        "silent_s": 0.005,
        "is_started": True,
        "unchanged_s": 0.0,
        "queue": 0.0,
    }
    return StreamWindow(**{**usual, **more})


def last(**more: Any) -> StreamWindow:
    """Return a window whose last bucket differs."""
    whole = window()
    return replace(whole, buckets=(*whole.buckets[:-1], replace(whole.buckets[-1], **more)))


def kinds(found: StreamWindow, limits: Tolerances = LIMITS) -> set[str]:
    return {finding.kind for finding in stream_findings([found], limits)}


def test_a_stream_as_expected_has_no_alarm() -> None:
    assert kinds(window()) == set()
    assert kinds(window(expected_hz=None)) == set()


@pytest.mark.parametrize(
    ("found", "kind"),
    [
        (window(trouble="the device is gone"), "trouble"),
        (window(silent_s=0.2), "gap"),
        (last(longest_gap_ns=S // 5), "gap"),
        (window(expected_hz=120.0), "rate"),
        (window(expected_hz=80.0), "rate"),
        (window(unchanged_s=1.5), "frozen"),
        (last(saturated=20), "saturation"),
        (last(bad_checksums=20), "checksum"),
        (last(implausible=20), "checksum"),
        (last(lost=1), "lost"),
        (last(least_offset_ns=8 * S), "clock"),
        (last(clock_backs=1), "clock"),
    ],
)
def test_each_check_finds_its_fault_alone(found: StreamWindow, kind: str) -> None:
    assert kinds(found) == {kind}


def test_every_check_is_tested_above() -> None:
    tested = {"trouble", "gap", "rate", "frozen", "saturation", "checksum", "lost", "clock"}
    assert {look.__name__ for look in CHECKS} == tested


def test_a_fault_that_is_older_than_the_window_is_over() -> None:
    old = [bucket(k, lost=5 * (k < 20), longest_gap_ns=S * (k < 20) + 1) for k in range(30)]
    assert kinds(window(*old)) == set()


def test_the_rate_is_not_judged_before_a_whole_window_nor_in_the_first_second() -> None:
    few = [bucket(k, samples=10, longest_gap_ns=1) for k in range(4)]
    assert kinds(window(*few)) == set()
    begun = [bucket(k, samples=90 * (k > 0) + 10, is_first=k == 0) for k in range(5)]
    assert kinds(window(*begun)) == set()


def test_a_slow_stream_is_judged_over_more_seconds() -> None:
    slow = [bucket(k, samples=k % 2, longest_gap_ns=2 * S) for k in range(60)]
    assert kinds(window(*slow, expected_hz=0.5, silent_s=1.0)) == set()
    assert kinds(window(*slow, expected_hz=1.0, silent_s=1.0)) == {"rate"}


def test_a_device_may_take_some_seconds_to_its_first_sample() -> None:
    nothing = tuple(bucket(k, samples=0, least_offset_ns=None) for k in range(2))
    assert kinds(window(*nothing, is_started=False, silent_s=START_S - 0.1)) == set()
    assert kinds(window(*nothing, is_started=False, silent_s=START_S + 0.1)) == {"gap"}


@given(st.integers(-3000, 3000), st.integers(20, 60), st.integers(-(10**18), 10**18))
def test_drift_is_the_slope_of_the_offset(ppm: int, seconds: int, offset_ns: int) -> None:
    known = [(float(k), offset_ns + round(ppm * 1e3 * k)) for k in range(seconds)]
    assert drift_ppm(known, LIMITS) == pytest.approx(ppm, abs=0.5)


def test_drift_alone_raises_the_clocks_alarm_and_a_jump_before_it_does_not_hide_it() -> None:
    jumped = [
        bucket(k, least_offset_ns=7 * S + k * 1_000_000 + 20 * S * (k > 15)) for k in range(60)
    ]
    (finding,) = stream_findings([window(*jumped)], LIMITS)
    assert finding.text == "the device's clock is 1000 ppm too slow"


def test_a_clock_that_wraps_at_32_bits_of_microseconds_is_said_to_jump() -> None:
    wrapped = [bucket(k, least_offset_ns=7 * S + (2**32 * 1000) * (k >= 28)) for k in range(30)]
    (finding,) = stream_findings([window(*wrapped)], LIMITS)
    assert finding.text == "the device's clock jumped by -4295 s"


def test_queues_are_one_alarm_for_all_devices() -> None:
    windows = [window(queue=0.9), replace(last(dropped=3), device="wrist", queue=0.6)]
    drop, queue = queue_findings(windows, LIMITS)
    assert "(wrist 3)" in drop.text
    assert "(imu 90%, wrist 60%)" in queue.text
    assert queue_findings([window(queue=0.4)], LIMITS) == []


@pytest.mark.parametrize(
    ("more", "text"),
    [
        ({"free": 500_000_000}, "500.0 MB are free: room for 40 s"),
        ({"free": 90_000_000}, "90.0 MB are free: room for 0 s"),
        ({"sync_s": 3.0}, "the disk has been busy for 3.0 s"),
    ],
)
def test_a_disk_that_is_nearly_full_or_slow_is_found(more: dict[str, Any], text: str) -> None:
    usual = {"free": 10**12, "reserve": 10**8, "bytes_per_s": 10e6, "sync_s": 0.0}
    assert disk_finding(DiskWindow(**usual), LIMITS) is None
    found = disk_finding(DiskWindow(**{**usual, **more}), LIMITS)
    assert found is not None
    assert found.text == text


def statistics(kind: DeviceKind, **config: Any) -> StreamStatistics:
    return StreamStatistics("d", kind, DeviceConfig(driver="x", **config), 0.5, 0)


def look(found: StreamStatistics, now_ns: int) -> StreamWindow:
    return found.look(now_ns, DeviceCounters(), dropped=0, queue=0.0, trouble="")


def sample(host_ns: int, payload: Payload, device_ns: int | None = None) -> Sample[Payload]:
    return Sample(device_ns=device_ns, host_ns=host_ns, sequence=None, payload=payload)


def force(value: float) -> WrenchReading:
    return WrenchReading(wrench=np.array([value, 0.0, 0.0, 0.0, 0.0, 0.0]))


@given(st.lists(st.integers(1, 10**8), min_size=1, max_size=50), st.integers(1, 5))
def test_buckets_count_every_sample_and_the_longest_gap(steps: list[int], parts: int) -> None:
    found, now = statistics(DeviceKind.FORCE_TORQUE), 0
    for place, step in enumerate(steps):
        now += step
        found.add(sample(now, force(place)))
        if place % parts == 0:
            look(found, now)
    seen = look(found, now + 1)
    assert sum(b.samples for b in seen.buckets) == len(steps) == found.total
    assert max(b.longest_gap_ns for b in seen.buckets) == max([0, *steps[1:]])
    assert rate_hz(seen.buckets) == pytest.approx(1e9 * len(steps) / (now + 1))


def test_saturation_is_of_the_quantity_that_was_named() -> None:
    found = statistics(DeviceKind.FORCE_TORQUE, full_scale={"force": 10.0})
    for place, value in enumerate((9.9, 10.0, -10.0)):
        found.add(sample(place, force(value)))
    found.add(sample(9, WrenchReading(wrench=np.array([0.0, 0.0, 0.0, 50.0, 0.0, 0.0]))))
    assert look(found, 10).buckets[-1].saturated == 2


def test_a_black_image_is_saturated_and_the_same_image_is_unchanged() -> None:
    found = statistics(DeviceKind.CAMERA)
    grey = np.full((48, 64, 3), 120, np.uint8)
    for place, rgb in enumerate((grey, grey, 0 * grey, 0 * grey)):
        found.add(sample(place * S, CameraFrame(rgb=rgb)))
    seen = look(found, 4 * S)
    assert seen.buckets[-1].saturated == 2
    assert seen.unchanged_s == 1.0
    assert seen.silent_s == 1.0


def test_a_driver_that_uses_its_image_again_is_not_frozen() -> None:
    found, image = statistics(DeviceKind.CAMERA), np.zeros((48, 64, 3), np.uint8)
    for place in range(3):
        image += 1
        found.add(sample(place * S, CameraFrame(rgb=image)))
    assert look(found, 2 * S).unchanged_s == 0.0


def test_a_device_time_that_goes_back_is_counted() -> None:
    found = statistics(DeviceKind.IMU)
    payload = InertialReading(specific_force=np.zeros(3), angular_velocity=np.zeros(3))
    for place, device_ns in enumerate((5, 9, 3, 4, None, 2)):
        found.add(sample(place, payload, device_ns))
    assert look(found, 10).buckets[-1].clock_backs == 1


@pytest.mark.parametrize("key", Tolerances.__dataclass_fields__)
def test_a_tolerance_out_of_range_is_refused(key: str) -> None:
    with pytest.raises(ConfigError, match=f"{key}: got -1"):
        Tolerances(**{key: -1.0})
