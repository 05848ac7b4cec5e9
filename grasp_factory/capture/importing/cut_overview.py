"""What helps a person to cut a session: its curves over time, its events, and proposals."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from grasp_factory.capture.importing.cuts import Cut, cuts_of
from grasp_factory.capture.importing.device_tracks import SessionTracks, gripper_series, tracks_of
from grasp_factory.capture.importing.grasp_columns import closings_of
from grasp_factory.capture.importing.import_settings import CutMethod, ImportSettings
from grasp_factory.capture.importing.session_contents import (
    RecordedEvent,
    SessionContents,
    read_contents,
)
from grasp_factory.core.geometry import Array
from grasp_factory.errors import CaptureError
from grasp_factory.signals.timeline import Ticks

MOST_POINTS = 4000
"""Points of a curve."""
MOST_EVENTS = 500
"""Events that are listed."""


@dataclass(frozen=True, slots=True, kw_only=True)
class OverviewCurve:
    """A quantity over time, with its smallest and largest value in each stretch of time."""

    name: str
    """``gripper_width`` (m), ``force`` (N) or ``angular_velocity`` (rad/s)."""
    times_s: Array
    """(K,) seconds from the session's start, ascending."""
    values: Array
    """(K,) in the unit of the quantity."""


@dataclass(frozen=True, slots=True, kw_only=True)
class CutOverview:
    """A session as a person sees it who cuts it."""

    contents: SessionContents
    start_ns: int
    """First time of a message, ns since the epoch."""
    duration_s: float
    curves: tuple[OverviewCurve, ...]
    events: tuple[RecordedEvent, ...]
    """The first ``MOST_EVENTS``."""
    cameras: tuple[str, ...]
    """Devices with colour images."""
    proposals: Mapping[CutMethod, tuple[Cut, ...]]
    """By method; a method that finds no episode is left out."""

    def since_start(self, time_ns: int) -> float:
        """Return a time in seconds from the session's start."""
        return (time_ns - self.start_ns) / 1e9


def cut_overview(session: Path, settings: ImportSettings) -> CutOverview:
    """Read a session but for its images.

    Args:
        session: its folder.
        settings: of the import: what the proposals go by.

    Raises:
        CaptureError: if it is no session, or damaged.
        UsageError: if the settings name a device that is not there.
        StoreError: if it needs too much memory or time.
    """
    contents = read_contents(session)
    tracks = tracks_of(contents, settings)
    first, last = contents.span
    return CutOverview(
        contents=contents,
        start_ns=first,
        duration_s=(last - first) / 1e9,
        curves=tuple(_curves(contents, tracks, first)),
        events=contents.events[:MOST_EVENTS],
        cameras=tuple(sorted(tracks.cameras)),
        proposals=_proposals(contents, tracks, settings),
    )


def _proposals(
    contents: SessionContents, tracks: SessionTracks, settings: ImportSettings
) -> dict[CutMethod, tuple[Cut, ...]]:
    found = {}
    closings = closings_of(contents, tracks, settings)
    for method in (CutMethod.EVENTS, CutMethod.GRIPPER):
        try:
            chosen = replace(settings, cut=method)
            found[method] = cuts_of(contents.events, closings, contents.span, chosen)
        except CaptureError:
            continue
    return found


def _curves(
    contents: SessionContents, tracks: SessionTracks, start_ns: int
) -> Sequence[OverviewCurve]:
    found: dict[str, tuple[Ticks, Array]] = {}
    if grip := gripper_series(tracks):
        found["gripper_width"] = grip
    if force := tracks.force_torque:
        found["force"] = force.times_ns, np.linalg.norm(force.values("wrench")[:, :3], axis=1)
    if imu := tracks.imu:
        rate = np.linalg.norm(imu.values("angular_velocity"), axis=1)
        found["angular_velocity"] = imu.times_ns, rate
    return [overview_curve(name, (times - start_ns) / 1e9, v) for name, (times, v) in found.items()]


def overview_curve(name: str, times_s: Array, values: Array) -> OverviewCurve:
    """Return a curve of at most ``MOST_POINTS`` points that loses no extreme."""
    there = np.isfinite(values)
    times_s, values = times_s[there], values[there]
    if len(values) > MOST_POINTS:
        edges = np.linspace(0, len(values), MOST_POINTS // 2 + 1).astype(np.int64)
        ends = [
            (a + values[a:b].argmin(), a + values[a:b].argmax())
            for a, b in itertools.pairwise(edges)
        ]
        kept = np.unique(np.array(ends))
        times_s, values = times_s[kept], values[kept]
    return OverviewCurve(name=name, times_s=times_s, values=values)
