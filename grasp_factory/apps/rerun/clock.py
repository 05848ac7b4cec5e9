"""The recording's one clock: simulation time in seconds since the arm started."""

from __future__ import annotations

from collections.abc import Iterable

import rerun as rr

from grasp_factory.core.geometry import Array

TIME = "time"


def seconds(times: Iterable[float]) -> rr.TimeColumn:
    """Return the clock's column for some times."""
    return rr.TimeColumn(TIME, duration=list(times))


def poses(values: Array) -> rr.ComponentColumnList:
    """Return the columns of poses (n, 7): position (m) and quat_xyzw."""
    return rr.Transform3D.columns(translation=values[:, :3], quaternion=values[:, 3:])
