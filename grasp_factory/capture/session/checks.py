"""Live checks: pure functions of a window of statistics, each of which finds one kind of fault."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from grasp_factory.capture.samples import DeviceKind
from grasp_factory.capture.session.stream_statistics import StreamWindow, rate_hz
from grasp_factory.capture.session.tolerances import Tolerances
from grasp_factory.core.alarm_book import Finding
from grasp_factory.core.text_format import size_text

FEWEST = 20
"""Samples that a window should have, so that one more or less is no change of the rate."""
START_S = 3.0
"""Seconds that a device may take until its first sample."""
UNKNOWN_GAP_S = 2.0
"""Longest time without a sample of a device whose rate is not known."""
FEWEST_OFFSETS = 20
"""Buckets from which the speed of a clock is estimated."""
_SLOW = "the disk or the processor is too slow"
SLOW_SYNC_S = 2.0
"""Seconds that the disk may take to store what was written."""


@dataclass(frozen=True, slots=True, kw_only=True)
class DiskWindow:
    """The disk now, and what the session writes to it."""

    free: int
    """Bytes."""
    reserve: int
    """Bytes that stay free."""
    bytes_per_s: float
    sync_s: float
    """Seconds that the disk has taken so far for its present work."""


def trouble(window: StreamWindow, limits: Tolerances) -> str:
    """Find a device that is gone, or whose samples cannot be stored."""
    return window.trouble


def rate(window: StreamWindow, limits: Tolerances) -> str:
    """Find a rate that differs from the expected one."""
    expected = window.expected_hz
    if expected is None:
        return ""
    seconds = max(limits.window_s, FEWEST / expected)
    buckets = window.latest(seconds)
    span = sum(b.end_ns - b.start_ns for b in buckets) / 1e9
    wanted = expected * span
    if span < 0.9 * seconds or any(b.is_first for b in buckets):
        return ""
    got = sum(b.samples for b in buckets)
    if abs(got - wanted) <= limits.rate * wanted + 1.0:
        return ""
    return f"{rate_hz(buckets):.4g} Hz, expected {expected:.4g} Hz"


def gap(window: StreamWindow, limits: Tolerances) -> str:
    """Find a time without samples."""
    most = longest_gap_s(window.expected_hz, limits)
    if window.silent_s > (most if window.is_started else max(most, START_S)):
        return f"no sample for {window.silent_s:.1f} s"
    longest = max((b.longest_gap_ns for b in window.latest(limits.window_s)), default=0) / 1e9
    return f"{longest:.3g} s without a sample, valid: up to {most:.3g} s" if longest > most else ""


def longest_gap_s(expected_hz: float | None, limits: Tolerances) -> float:
    """Return the longest time without a sample that is no fault."""
    if expected_hz is None:
        return max(UNKNOWN_GAP_S, limits.gap_s)
    return max(limits.gap_s, limits.gap_periods / expected_hz)


def frozen(window: StreamWindow, limits: Tolerances) -> str:
    """Find values that do not change although samples come."""
    if window.unchanged_s <= limits.frozen_s:
        return ""
    what = "image" if window.kind is DeviceKind.CAMERA else "values"
    return f"the same {what} for {window.unchanged_s:.1f} s"


def saturation(window: StreamWindow, limits: Tolerances) -> str:
    """Find samples at full scale, and images that are black or white."""
    buckets = window.latest(limits.window_s)
    got, total = sum(b.saturated for b in buckets), sum(b.samples for b in buckets)
    if not total or got <= limits.saturated * total:
        return ""
    what = "black or white" if window.kind is DeviceKind.CAMERA else "at full scale"
    return f"{got} of {total} samples are {what}"


def checksum(window: StreamWindow, limits: Tolerances) -> str:
    """Find damaged packets, and samples that cannot be true."""
    buckets = window.latest(limits.window_s)
    bad = sum(b.bad_checksums + b.implausible for b in buckets)
    total = bad + sum(b.samples for b in buckets)
    return f"{bad} of {total} packets are damaged" if bad > limits.bad_checksums * total else ""


def lost(window: StreamWindow, limits: Tolerances) -> str:
    """Find samples that the device made and that did not arrive."""
    got = sum(b.lost for b in window.latest(limits.window_s))
    return f"{got} samples did not arrive, by the device's own count" if got else ""


def clock(window: StreamWindow, limits: Tolerances) -> str:
    """Find a device's clock that jumps, or runs at another speed than this machine's."""
    known = [
        (b.end_ns / 1e9, b.least_offset_ns)
        for b in window.buckets
        if b.least_offset_ns is not None and b.samples
    ]
    recent = window.latest(limits.window_s)
    if not recent:
        return ""
    if backs := sum(b.clock_backs for b in recent):
        return f"the device's clock went back ({backs} times)"
    start = recent[0].start_ns / 1e9
    for (_, before), (at, after) in pairwise(known):
        jump = (after - before) / 1e9
        if at >= start and abs(jump) > limits.clock_jump_s:
            return f"the device's clock jumped by {-jump:.4g} s"
    drift = drift_ppm(known, limits)
    if drift is None or abs(drift) <= limits.clock_drift_ppm:
        return ""
    return f"the device's clock is {abs(drift):.0f} ppm too {'slow' if drift > 0 else 'fast'}"


def drift_ppm(known: Sequence[tuple[float, int]], limits: Tolerances) -> float | None:
    """Return the growth of host time minus device time since the last jump, in ppm.

    Args:
        known: time in s and least offset in ns of buckets, in order.
        limits: from when on a change is a jump.

    Returns:
        None if there are too few.
    """
    first = 0
    for place, ((_, before), (_, after)) in enumerate(pairwise(known), 1):
        if abs(after - before) > limits.clock_jump_s * 1e9:
            first = place
    steady = known[first:]
    if len(steady) < FEWEST_OFFSETS:
        return None
    times = np.array([at - steady[0][0] for at, _ in steady])
    offsets = np.array([(offset - steady[0][1]) / 1e9 for _, offset in steady])
    return float(1e6 * np.polyfit(times, offsets, 1)[0])


CHECKS: Sequence[Callable[[StreamWindow, Tolerances], str]] = (
    trouble,
    gap,
    rate,
    frozen,
    saturation,
    checksum,
    lost,
    clock,
)
"""All checks of a stream, the most urgent first; each returns a text, empty if all is well."""


def stream_findings(windows: Iterable[StreamWindow], limits: Tolerances) -> list[Finding]:
    """Return what is wrong with the streams."""
    return [
        Finding(kind=look.__name__, text=text, source=window.device)
        for window in windows
        for look in CHECKS
        if (text := look(window, limits))
    ]


def queue_findings(windows: Collection[StreamWindow], limits: Tolerances) -> list[Finding]:
    """Return what is wrong with the way of all samples to the disk: drops, and queues that fill."""
    fill = {window.device: window.queue for window in windows if window.queue > limits.queue}
    drops = {
        window.device: got
        for window in windows
        if (got := sum(b.dropped for b in window.latest(limits.window_s)))
    }
    found = []
    if drops:
        which = ", ".join(f"{name} {number}" for name, number in drops.items())
        found.append(Finding(kind="drop", text=f"samples dropped ({which}): {_SLOW}"))
    if fill:
        which = ", ".join(f"{name} {share:.0%}" for name, share in fill.items())
        found.append(Finding(kind="queue", text=f"queues fill up ({which}): {_SLOW}"))
    return found


def disk_finding(disk: DiskWindow, limits: Tolerances) -> Finding | None:
    """Find a disk that is nearly full, or too slow."""
    room = disk.free - disk.reserve
    if disk.sync_s > SLOW_SYNC_S:
        return Finding(kind="disk", text=f"the disk has been busy for {disk.sync_s:.1f} s")
    if room >= disk.bytes_per_s * limits.disk_s and room > 0:
        return None
    seconds = max(0.0, room / disk.bytes_per_s) if disk.bytes_per_s > 0.0 else 0.0
    text = f"{size_text(disk.free)} are free: room for {seconds:.0f} s"
    return Finding(kind="disk", text=text)
