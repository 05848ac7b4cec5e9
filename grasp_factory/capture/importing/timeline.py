"""The time series of a real episode: on the streams' timeline, and at the devices' own times."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from grasp_factory.capture.importing.device_tracks import (
    RecordedTrack,
    SessionTracks,
    gripper_column,
    measured,
)
from grasp_factory.capture.importing.import_settings import ImportSettings
from grasp_factory.capture.importing.session_contents import SessionContents
from grasp_factory.capture.sync.interpolation import interpolate
from grasp_factory.capture.sync.sync_settings import SyncSettings
from grasp_factory.core.geometry import Array, matrix_to_quat_xyzw
from grasp_factory.errors import CaptureError
from grasp_factory.robots import ROBOTS
from grasp_factory.robots.base import arm_chain

_NS = 1e9
_GRIPPER = ("gripper_width", "gripper_force", "gripper_width_target")


@dataclass(frozen=True, slots=True, kw_only=True)
class EpisodeSpan:
    """An episode's time."""

    start_ns: int
    end_ns: int

    def seconds(self, track: RecordedTrack) -> Array:
        """Return the times of a track since the start, seconds; of all its samples."""
        return (track.times_ns - self.start_ns) / _NS

    def own_times(self, track: RecordedTrack) -> Array:
        """Return the times of the samples in the episode."""
        return self.seconds(track)[track.within(self.start_ns, self.end_ns)]

    @property
    def duration_s(self) -> float:
        """Length, seconds."""
        return (self.end_ns - self.start_ns) / _NS


def joint_arrays(tracks: SessionTracks, joints: int) -> dict[str, Array]:
    """Return the states of joints and gripper (N, ...) of the whole session, by name.

    The joints of the store that the arm does not have are NaN.

    Args:
        tracks: the devices of the session.
        joints: of the store.

    Raises:
        CaptureError: if the arm has more.
    """
    track = tracks.joint_states
    if track is None:
        return {}
    column = gripper_column(track)
    found = {
        name: _arm(track.values(of), column, joints, len(track.times_ns))
        for name, of in (("positions", "positions"), ("velocities", "velocities"),
                         ("torques", "efforts"))
    }  # fmt: skip
    width, force = (
        _one(track.values(n), column, len(track.times_ns)) for n in ("positions", "efforts")
    )
    return found | {"gripper_width": width, "gripper_force": force}


def command_arrays(tracks: SessionTracks, joints: int) -> dict[str, Array]:
    """Return the commands to joints and gripper; see ``joint_arrays``."""
    track = tracks.joint_commands
    if track is None:
        return {}
    column = gripper_column(track)
    values, count = track.values("positions"), len(track.times_ns)
    return {
        "position_targets": _arm(values, column, joints, count),
        "gripper_width_target": _one(values, column, count),
    }


def _arm(values: Array, gripper: int | None, joints: int, count: int) -> Array:
    arm = values if gripper is None or not values.size else np.delete(values, gripper, axis=1)
    out = np.full((count, joints), np.nan)
    if arm.size:
        if arm.shape[1] > joints:
            raise CaptureError(
                f"the arm has {arm.shape[1]} joints, the store's robot {joints}: choose a config"
                " with another robot"
            )
        out[:, : arm.shape[1]] = arm
    return out


def _one(values: Array, column: int | None, count: int) -> Array:
    return np.full(count, np.nan) if column is None or not values.size else values[:, column]


def on_timeline(
    track: RecordedTrack | None,
    arrays: Mapping[str, Array],
    span: EpisodeSpan,
    at: Array,
    settings: ImportSettings,
) -> dict[str, Array]:
    """Return arrays of a track at instants, by linear interpolation; NaN across long gaps.

    Samples in which nothing of an array was measured are left out: they are part of a gap.
    """
    if track is None:
        return {}
    times = span.seconds(track)
    streams = {}
    for name, values in arrays.items():
        there = np.isfinite(values.reshape(len(values), -1)).any(axis=1)
        kept = there if there.any() else np.ones_like(there)
        streams[name] = times[kept], values[kept]
    found = interpolate(streams, at, SyncSettings(slop_s=settings.max_gap_s))
    return {name: each.values for name, each in found.items()}


def stream_arrays(
    contents: SessionContents,
    tracks: SessionTracks,
    span: EpisodeSpan,
    at: Array,
    settings: ImportSettings,
    *,
    robot: str,
) -> dict[str, Any]:
    """Return what is known of the streams, (n, ...) at the instants ``at``, by name."""
    joints = len(ROBOTS[robot].arm_joints)
    state = on_timeline(tracks.joint_states, joint_arrays(tracks, joints), span, at, settings)
    state |= on_timeline(tracks.joint_commands, command_arrays(tracks, joints), span, at, settings)
    found: dict[str, Any] = {
        name if name in _GRIPPER else f"joint_{name}": values for name, values in state.items()
    }
    if tracks.force_torque:
        wrench = {"wrist_wrench": tracks.force_torque.values("wrench")}
        found |= on_timeline(tracks.force_torque, wrench, span, at, settings)
    if settings.kinematics and "joint_positions" in found:
        found["tcp_pose"] = tcp_poses(robot, found["joint_positions"])
    return found


def tcp_poses(robot: str, positions: Array) -> Array:
    """Return the TCP's pose (n, 7) in the base frame from joint positions (n, J); NaN for NaN."""
    out = np.full((len(positions), 7), np.nan)
    there = np.isfinite(positions).all(axis=1)
    if there.any():
        T = arm_chain(ROBOTS[robot]).fk(positions[there])
        quats = np.stack([matrix_to_quat_xyzw(R) for R in T[:, :3, :3]])
        out[there] = np.concatenate([T[:, :3, 3], quats], axis=1)
    return out


def own_series(
    contents: SessionContents, tracks: SessionTracks, span: EpisodeSpan, joints: int
) -> dict[str, dict[str, Array]]:
    """Return the series at the devices' own times, by group and name."""
    found: dict[str, dict[str, Array]] = {}

    def add(group: str, track: RecordedTrack | None, arrays: Mapping[str, Any]) -> None:
        if track is not None:
            inside = track.within(span.start_ns, span.end_ns)
            cut = {name: values[inside] for name, values in arrays.items()}
            found[group] = {"timestamp": span.own_times(track), **cut}

    if tracks.imu:
        names = ("specific_force", "angular_velocity")
        add("imu", tracks.imu, {name: tracks.imu.values(name) for name in names})
    if tracks.force_torque:
        add("force_torque", tracks.force_torque, {"wrench": tracks.force_torque.values("wrench")})
    if tracks.taxels:
        frames = measured(contents.taxels[tracks.taxels.series.topic][tracks.taxels.places])
        add("taxels", tracks.taxels, {"pressure": frames})
    if tracks.joint_states:
        states = joint_arrays(tracks, joints)
        commands = command_arrays(tracks, joints)
        times = span.seconds(tracks.joint_states)
        if tracks.joint_commands:
            latest = np.searchsorted(span.seconds(tracks.joint_commands), times, side="right") - 1
            states |= {
                name: np.where(
                    (latest >= 0).reshape(-1, *[1] * (values.ndim - 1)), values[latest], np.nan
                )
                for name, values in commands.items()
            }
        add("joints", tracks.joint_states, states)
    return found
