"""Logging the table and visual aids: the grasp and the path of the hand."""

from __future__ import annotations

import numpy as np
import rerun as rr

from grasp_factory.apps.rerun.clock import poses, seconds
from grasp_factory.core import palette
from grasp_factory.core.episode import Episode
from grasp_factory.core.geometry import Array
from grasp_factory.core.palette import rgb
from grasp_factory.core.workspace import TABLE_CENTER_XY, TABLE_SIZE

GRASP = "world/grasp"
TCP = "world/tcp"
STEM = 0.08
"""Length in metres of the arrow along a grasp's approach."""
AXIS = 0.05
"""Length in metres of the axes of the hand."""


def log_scenery(recording: rr.RecordingStream, episode: Episode) -> None:
    """Log the table's box, the executed (or else first planned) grasp, and the path of the TCP."""
    recording.log("world", rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
    center = (*TABLE_CENTER_XY, -TABLE_SIZE[2] / 2.0)
    color = [round(255 * value) for value in episode.spec.surroundings.table.color]
    table = rr.Boxes3D(sizes=[TABLE_SIZE], centers=[center], colors=[color])
    recording.log("world/table", table, static=True)
    columns = episode.columns
    if np.linalg.norm(columns["grasp_quat_xyzw"]) > 0.0:  # false for NaN
        _log_grasp(recording, columns["grasp_position"], columns["grasp_quat_xyzw"],
                   float(columns["grasp_width"]))  # fmt: skip
    if episode.n_steps and np.isfinite(episode.streams["tcp_pose"]).all():
        _log_hand(recording, episode.streams["timestamp"], episode.streams["tcp_pose"])


def _log_grasp(
    recording: rr.RecordingStream, position: Array, quat_xyzw: Array, width: float
) -> None:
    """Log an arrow along the approach to the TCP, and one from each pad towards the other."""
    placed = rr.Transform3D(translation=position, quaternion=rr.Quaternion(xyzw=quat_xyzw))
    half = width / 2.0
    arrows = rr.Arrows3D(
        origins=[(0.0, 0.0, -STEM), (0.0, half, 0.0), (0.0, -half, 0.0)],
        vectors=[(0.0, 0.0, STEM), (0.0, -half, 0.0), (0.0, half, 0.0)],
        colors=[rgb(palette.GRASP)] * 3,
    )
    recording.log(GRASP, placed, arrows, static=True)


def _log_hand(recording: rr.RecordingStream, times: Array, tcp: Array) -> None:
    recording.log(TCP, rr.TransformAxes3D(AXIS), static=True)
    recording.send_columns(TCP, [seconds(times)], poses(tcp))
    recording.log("world/tcp_path", rr.LineStrips3D([tcp[:, :3]]), static=True)
