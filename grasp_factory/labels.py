"""The label of an attempt, from recorded streams alone, so that anyone can derive it again."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from grasp_factory.geometry import Array, Pose, apply, inverse, rotation_vector
from grasp_factory.outcome import Label, Outcome, Phase
from grasp_factory.sections import LabelConfig

FELL_OFF = -0.05
"""Metres: a centre of mass this far below the table top has left the table."""

Streams = Mapping[str, NDArray[Any]]


@dataclass(frozen=True, slots=True, kw_only=True)
class Measurements:
    """The figures behind a label; NaN where the attempt did not come that far."""

    lift_height: float = float("nan")
    """Rise of the target's centre of mass from its rest to the end, metres."""
    slip_distance: float = float("nan")
    """Way of the centre of mass in the TCP frame from the end of the closing to the end, metres."""
    slip_angle: float = float("nan")
    """Turn of the target in the TCP frame over the same time, rad."""
    min_grip_force: float = float("nan")
    """Smallest normal force of either pad on the target during the hold, N."""
    hold_duration: float = 0.0
    """Time during which both pads touched the target in the hold, seconds."""


def touching(streams: Streams) -> NDArray[np.bool_]:
    """Return which pads touch the target, (n, 2)."""
    return np.asarray((streams["tactile_body"] == Label.TARGET).any(axis=2))


def pad_normal_force(streams: Streams) -> Array:
    """Return each pad's normal force on the target, (n, 2) N, summed over its contacts."""
    normal = np.nan_to_num(streams["tactile_normal"].astype(np.float64))
    force = np.nan_to_num(streams["tactile_force"].astype(np.float64))
    on_target = streams["tactile_body"] == Label.TARGET
    return np.asarray(((normal * force).sum(axis=3) * on_target).sum(axis=2))


def target_com(streams: Streams, object_com: Array) -> Array:
    """Return the target's centre of mass over time, (n, 3) world, metres.

    Args:
        streams: The episode's streams.
        object_com: Centre of mass in the object's own frame, (3,) metres.
    """
    poses = streams["object_pose"][:, 0].astype(np.float64)
    return np.array([apply(_matrix(pose), object_com) for pose in poses]).reshape(-1, 3)


def measure(streams: Streams, object_com: Array, rest_height: float) -> Measurements:
    """Return the measurements of an executed attempt."""
    phase = streams["phase"]
    closed = np.flatnonzero(phase == Phase.CLOSE)
    if not len(closed):
        return Measurements()
    start, end = _in_hand(streams, closed[-1]), _in_hand(streams, len(phase) - 1)
    way = apply(end, object_com) - apply(start, object_com)
    hold = phase == Phase.HOLD
    both = touching(streams)[hold].all(axis=1)
    period = float(np.diff(streams["timestamp"][-2:]).sum())
    final = apply(_matrix(streams["object_pose"][-1, 0].astype(np.float64)), object_com)
    return Measurements(
        lift_height=float(final[2] - rest_height),
        slip_distance=float(np.linalg.norm(way)),
        slip_angle=float(np.linalg.norm(rotation_vector(end[:3, :3] @ start[:3, :3].T))),
        min_grip_force=float(pad_normal_force(streams)[hold].min()) if hold.any() else float("nan"),
        hold_duration=float(both.sum() * period),
    )


def judge(streams: Streams, object_com: Array, rest_height: float, label: LabelConfig) -> Outcome:
    """Return the outcome of an attempt in which the gripper closed.

    Success means that at the end of the hold both pads touch the target and its centre of mass
    is at least ``label.min_lift`` above its rest.
    """
    phase, touch = streams["phase"], touching(streams).all(axis=1)
    height = target_com(streams, object_com)[:, 2] - rest_height
    up = touch & (height >= label.min_lift)
    if phase[-1] == Phase.HOLD and up[-1]:
        return Outcome.SUCCESS
    if height[-1] + rest_height < FELL_OFF:
        return Outcome.LEFT_WORKSPACE
    if not touch.any():
        return Outcome.NO_CONTACT
    lifted = np.flatnonzero(phase == Phase.LIFT)
    return Outcome.LOST_IN_HOLD if len(lifted) and up[lifted[-1]] else Outcome.LOST_IN_LIFT


def _in_hand(streams: Streams, i: int) -> Array:
    """Return ``T_tcp_object`` (4, 4) at record i."""
    T_world_tcp = _matrix(streams["tcp_pose"][i].astype(np.float64))
    return inverse(T_world_tcp) @ _matrix(streams["object_pose"][i, 0].astype(np.float64))


def _matrix(pose: Array) -> Array:
    x, y, z, qx, qy, qz, qw = (float(v) for v in pose)
    return Pose((x, y, z), (qx, qy, qz, qw)).matrix()
