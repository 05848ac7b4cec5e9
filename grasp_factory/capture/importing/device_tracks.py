"""The devices of a session on the host's clock: which there are, and when each sample was taken."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from grasp_factory.capture.clocks.clock_fit import ClockFit, fit_clock
from grasp_factory.capture.clocks.clock_rule import ClockRule
from grasp_factory.capture.importing.import_settings import ImportSettings
from grasp_factory.capture.importing.session_contents import SessionContents
from grasp_factory.capture.ros_messages import IMAGE, IMU, JOINT_STATE, WRENCH
from grasp_factory.capture.samples import DeviceKind
from grasp_factory.capture.session_series import DeviceSeries
from grasp_factory.core.geometry import Array
from grasp_factory.errors import CaptureError, UsageError, shown
from grasp_factory.signals.timeline import Ticks

_LARGEST = float(np.finfo(np.float32).max)
Real = TypeVar("Real", np.float32, np.float64)
_FEWEST_COUNTED = 100
"""A period that is known from fewer samples is too uncertain."""
_COUNT_DRIFT_PPM = 20_000.0
"""The period is that between the first and the last arrival, which may be late."""


@dataclass(frozen=True, slots=True, kw_only=True)
class RecordedTrack:
    """The samples of one topic on the host's clock."""

    series: DeviceSeries
    times_ns: Ticks
    """(K,) when each sample was taken, ns since the epoch, strictly ascending."""
    places: NDArray[np.int64]
    """(K,) places of these samples in the series; samples whose clock went back are left out."""
    clock: Mapping[str, Any]
    """The report of the fit; empty for a device without a clock."""

    def values(self, name: str) -> Array:
        """Return an array of the series, (K, ...); infinity is no measurement: NaN."""
        return measured(self.series.values[name][self.places])

    def within(self, start_ns: int, end_ns: int) -> slice:
        """Return the samples of a span, both ends included."""
        first = int(np.searchsorted(self.times_ns, start_ns))
        return slice(first, int(np.searchsorted(self.times_ns, end_ns, side="right")))


@dataclass(frozen=True, slots=True, kw_only=True)
class SessionTracks:
    """The tracks that an import uses; None for what the session does not have."""

    cameras: Mapping[str, RecordedTrack]
    """Colour images by device."""
    depths: Mapping[str, RecordedTrack]
    """Depth images by device."""
    imu: RecordedTrack | None
    force_torque: RecordedTrack | None
    taxels: RecordedTrack | None
    joint_states: RecordedTrack | None
    joint_commands: RecordedTrack | None

    def named(self) -> dict[str, RecordedTrack]:
        """Return all tracks but depths and commands by device."""
        others = (self.imu, self.force_torque, self.taxels, self.joint_states)
        return {**self.cameras, **{t.series.device: t for t in others if t is not None}}


def tracks_of(contents: SessionContents, settings: ImportSettings) -> SessionTracks:
    """Return the tracks of a session.

    Raises:
        UsageError: if the settings name a device that is not there.
    """

    def pick(kind: DeviceKind, message_type: str, device: str, *, commands: bool = False) -> Any:
        found = {
            each.device: each
            for each in contents.series.values()
            if each.kind is kind
            and each.message_type == message_type
            and is_command(each) is commands
            and len(each)
        }
        if device and device not in found and not commands:
            raise UsageError(
                f"the session has no {kind.name.lower()} device {shown(device)}, valid:"
                f" {', '.join(found) or 'none'}"
            )
        chosen = found.get(device) if device else next(iter(found.values()), None)
        return track_of(chosen, settings) if chosen else None

    images = [
        each
        for each in contents.series.values()
        if each.kind is DeviceKind.CAMERA and each.message_type == IMAGE and len(each)
    ]
    states: RecordedTrack | None = pick(DeviceKind.JOINTS, JOINT_STATE, settings.joints)
    is_depth = {each.topic: each.topic in contents.depth_topics for each in images}
    return SessionTracks(
        cameras={e.device: track_of(e, settings) for e in images if not is_depth[e.topic]},
        depths={e.device: track_of(e, settings) for e in images if is_depth[e.topic]},
        imu=pick(DeviceKind.IMU, IMU, settings.imu),
        force_torque=pick(DeviceKind.FORCE_TORQUE, WRENCH, settings.force_torque),
        taxels=pick(DeviceKind.TACTILE, IMAGE, settings.tactile),
        joint_states=states,
        joint_commands=pick(
            DeviceKind.JOINTS,
            JOINT_STATE,
            states.series.device if states else settings.joints,
            commands=True,
        ),
    )


def is_command(series: DeviceSeries) -> bool:
    """Return whether a series of joints is of commands: these have no velocities."""
    velocities = series.values.get("velocities")
    positions = series.values.get("positions")
    has_none = velocities is not None and velocities.size == 0
    return has_none and positions is not None and positions.size > 0


def track_of(series: DeviceSeries, settings: ImportSettings) -> RecordedTrack:
    """Return a series on the host's clock; see ``clocks.clock_fit``.

    A device without a clock that samples at a steady rate has the count of its samples as a clock.
    Samples of other devices have the time of their arrival; those that arrived at once are 1 ns
    apart, so none is lost.

    Raises:
        CaptureError: if its times cannot be used.
    """
    arrived = np.maximum.accumulate(series.log_time_ns)
    latency = settings.latency_s.get(series.device, 0.0)
    try:
        fit = _fit(series, arrived, latency)
    except UsageError as error:
        raise CaptureError(f"{shown(series.topic)}: {error}") from None
    if fit is None:
        order = np.arange(len(arrived))
        times = np.maximum.accumulate(arrived - order) + order - round(latency * 1e9)
        return RecordedTrack(series=series, times_ns=times, places=order, clock={})
    times = fit.host_ns
    before = np.maximum.accumulate(np.concatenate([[np.iinfo(np.int64).min], times[:-1]]))
    places = np.flatnonzero(times > before)
    clock = {"by": "device" if series.device_ns is not None else "count", **asdict(fit.report())}
    return RecordedTrack(series=series, times_ns=times[places], places=places, clock=clock)


def _fit(series: DeviceSeries, arrived: Ticks, latency_s: float) -> ClockFit | None:
    if series.device_ns is not None:
        return fit_clock(series.device_ns, arrived, ClockRule(latency_s=latency_s))
    count = series.sequence if series.sequence is not None else np.arange(len(arrived))
    if len(count) < _FEWEST_COUNTED or np.diff(count).min() < 1:
        return None
    period = (arrived[-1] - arrived[0]) / (count[-1] - count[0])
    rule = ClockRule(latency_s=latency_s, max_drift_ppm=_COUNT_DRIFT_PPM)
    fit = fit_clock(np.round((count - count[0]) * period).astype(np.int64), arrived, rule)
    # Samples that are missing in the count make those after them late by whole periods.
    is_steady = len(fit.pieces) == 1 and np.median(fit.delays_ns) < period / 2
    return fit if is_steady else None


def measured(values: NDArray[Real]) -> NDArray[Real]:
    """Return a copy of values with NaN where one is no number that a store can hold (float32)."""
    return np.where(np.abs(values) <= _LARGEST, values, np.nan).astype(values.dtype)


def gripper_column(track: RecordedTrack | None) -> int | None:
    """Return the column of the gripper among the joints; None without one."""
    if track is None or not track.series.has_gripper:
        return None
    return -1


def gripper_series(tracks: SessionTracks) -> tuple[Ticks, Array] | None:
    """Return times (K,) in ns and widths (K,) in m of the gripper, without NaN; None without."""
    track = tracks.joint_states
    column = gripper_column(track)
    if track is None or column is None or not track.series.values["positions"].size:
        return None
    width = track.values("positions")[:, column]
    there = np.isfinite(width)
    return (track.times_ns[there], width[there]) if there.any() else None
