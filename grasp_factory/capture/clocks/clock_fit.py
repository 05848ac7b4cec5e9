"""The fit of a device's clock to the host's, of all samples of a recording.

The times of the samples are not changed; the fit returns other ones.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from grasp_factory.capture.clocks.clock_piece import ClockPiece, piece_of
from grasp_factory.capture.clocks.clock_rule import NS, ClockRule
from grasp_factory.capture.clocks.jump_detection import JumpDetector
from grasp_factory.errors import UsageError
from grasp_factory.signals.timeline import Ticks

_EARLIEST, _LATEST = -(2**62), 2**62


@dataclass(frozen=True, slots=True, kw_only=True)
class ClockReport:
    """What a fit found, for people and for checks."""

    samples: int
    pieces: int
    starts: tuple[str, ...]
    """Why each piece begins; the first is ``first_sample``."""
    drift_ppm: float
    """Of the longest piece: how much faster the host's clock runs than the device's, 1e-6."""
    median_delay_ms: float
    """Delays after the fit's times; a sample's real delay is longer by that of the fastest."""
    p95_delay_ms: float
    longest_delay_ms: float


@dataclass(frozen=True, slots=True, kw_only=True)
class ClockFit:
    """A device's samples on the host's clock."""

    host_ns: Ticks
    """(N,) when each sample was taken, on the host's monotonic clock, ns."""
    delays_ns: Ticks
    """(N,) by how much later each sample arrived."""
    pieces: tuple[ClockPiece, ...]

    def report(self) -> ClockReport:
        """Return drift, jumps and delays."""
        longest = max(self.pieces, key=lambda piece: piece.count)
        median, high = np.percentile(self.delays_ns, (50.0, 95.0)) / 1e6
        return ClockReport(
            samples=len(self.host_ns),
            pieces=len(self.pieces),
            starts=tuple(piece.start.reason.name.lower() for piece in self.pieces),
            drift_ppm=longest.drift * 1e6,
            median_delay_ms=float(median),
            p95_delay_ms=float(high),
            longest_delay_ms=float(self.delays_ns.max() / 1e6),
        )


def fit_clock(device_ns: ArrayLike, host_ns: ArrayLike, rule: ClockRule | None = None) -> ClockFit:
    """Return a device's samples on the host's clock.

    Args:
        device_ns: (N,) the device's own times, ns, as they came: with jumps and wraps.
        host_ns: (N,) when the samples arrived, ns, of a clock that does not go back.
        rule: the settings; None for the defaults.

    Raises:
        UsageError: for no samples, numbers of another kind, or host times that descend.
    """
    rule = rule or ClockRule()
    device, host = _ticks(device_ns, "device_ns"), _ticks(host_ns, "host_ns")
    if device.shape != host.shape or not len(device):
        got = f"got {len(device)} and {len(host)}"
        raise UsageError(f"fit_clock: {got} times, valid: as many of both, 1 or more")
    wrong = np.flatnonzero(np.diff(host) < 0)
    if len(wrong):
        raise UsageError(f"fit_clock: host_ns descends after sample {wrong[0]}; valid: ascending")
    pieces = _pieces(device, host, rule)
    times = np.concatenate([_times_of(piece, device) for piece in pieces])
    times -= round(rule.latency_s * NS)
    return ClockFit(host_ns=times, delays_ns=host - times, pieces=pieces)


def _pieces(device: Ticks, host: Ticks, rule: ClockRule) -> tuple[ClockPiece, ...]:
    pairs = list(zip(device.tolist(), host.tolist(), strict=True))
    detector = JumpDetector(rule)
    starts = [found for pair in pairs if (found := detector.add(*pair))]
    ends = [start.index for start in starts[1:]] + [len(pairs)]
    return tuple(
        piece_of(start, pairs[start.index : end], rule)
        for start, end in zip(starts, ends, strict=True)
    )


def _times_of(piece: ClockPiece, device: Ticks) -> Ticks:
    first = piece.start.index
    return piece.host_times(device[first : first + piece.count])


def _ticks(values: ArrayLike, name: str) -> Ticks:
    ticks = np.asarray(values)
    is_whole = ticks.ndim == 1 and ticks.dtype.kind in "iu"
    if not is_whole or (ticks.size and not _EARLIEST < ticks.min() <= ticks.max() < _LATEST):
        raise UsageError(f"fit_clock: {name}: valid: (N,) whole nanoseconds below 2**62")
    return ticks.astype(np.int64)
