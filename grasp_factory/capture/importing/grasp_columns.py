"""The grasp of a real episode: when the gripper closes, where, and how wide it was before."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from grasp_factory.capture.importing.device_tracks import SessionTracks, gripper_series
from grasp_factory.capture.importing.gripper_motion import GripperClosing, closings
from grasp_factory.capture.importing.import_settings import ImportSettings
from grasp_factory.capture.importing.session_contents import SessionContents
from grasp_factory.capture.importing.timeline import EpisodeSpan
from grasp_factory.core.geometry import Array
from grasp_factory.signals.timeline import Ticks


def grasp_columns(
    closing: GripperClosing | None,
    grip: tuple[Ticks, Array] | None,
    streams: Mapping[str, Any],
    at: Array,
    span: EpisodeSpan,
) -> dict[str, Any]:
    """Return the grasp: the TCP's pose when the gripper is closed, and its width before that."""
    if closing is None or grip is None:
        return {}
    times, width = grip
    out: dict[str, Any] = {"grasp_width": float(width[np.searchsorted(times, closing.begins_ns)])}
    if "tcp_pose" in streams:
        closed = (closing.closed_ns - span.start_ns) / 1e9
        pose = streams["tcp_pose"][min(int(np.searchsorted(at, closed)), len(at) - 1)]
        if np.isfinite(pose).all():
            out |= {"grasp_position": pose[:3], "grasp_quat_xyzw": pose[3:]}
    return out


def closings_of(
    contents: SessionContents, tracks: SessionTracks, settings: ImportSettings
) -> tuple[GripperClosing, ...]:
    """Return every closing of the gripper in a session."""
    grip = gripper_series(tracks)
    return tuple(closings(*grip, settings.min_stroke_m)) if grip else ()
