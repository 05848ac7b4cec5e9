"""The label rule: derive the outcome of an attempt from its recorded streams alone."""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from grasp_factory.core.config.label import LabelConfig
from grasp_factory.core.enums import Label, Outcome, Phase
from grasp_factory.core.episode import Streams
from grasp_factory.core.geometry import Array, apply, inverse, pose_matrices, rotation_vector
from grasp_factory.core.linear import length, norm, product, turned

FELL_OFF = -0.05
"""Metres: a centre of mass this far below the table top has left the table."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Measurements:
    """The measurements behind a label; NaN if the attempt ended before that phase.

    Units and meanings are those of the columns of the same names (``schema.py``).
    """

    lift_height: float = math.nan
    slip_distance: float = math.nan
    slip_angle: float = math.nan
    min_grip_force: float = math.nan
    hold_duration: float = 0.0
    shake_level: float = 0.0
    loss_time: float = math.nan
    max_penetration: float = math.nan
    contact_area: float = math.nan


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
    T_world_object = pose_matrices(streams["object_pose"][:, 0])
    return turned(T_world_object[:, :3, :3], object_com) + T_world_object[:, :3, 3]


def disturbance(streams: Streams, object_com: Array, rest_pose: Array) -> tuple[Array, Array]:
    """Return the displacement and the lift of each object (M,), metres; NaN without an attempt.

    The displacement of the centre of mass is measured from its rest to the last record. The lift
    is its rise until the end of the hold, or until the end of the attempt if that is earlier.

    Args:
        streams: The episode's streams.
        object_com: Centres of mass in the objects' own frames, (M, 3) metres.
        rest_pose: The objects' poses (M, 7) before the attempt.
    """
    before_shake = np.flatnonzero(streams["phase"] != Phase.SHAKE)
    if not len(before_shake):
        nothing = np.full(len(object_com), np.nan)
        return nothing, nothing.copy()
    poses = streams["object_pose"][[-1, before_shake[-1]]].astype(np.float64)
    T_world_object = pose_matrices(np.stack([rest_pose, *poses]))
    offsets = turned(T_world_object[..., :3, :3], object_com)
    rest, end, held = offsets + T_world_object[..., :3, 3]
    return norm(end - rest), (held - rest)[:, 2]


def measure(streams: Streams, object_com: Array, rest_height: float) -> Measurements:
    """Return the measurements of an executed attempt.

    Args:
        streams: The episode's streams.
        object_com: Centre of mass in the object's own frame, (3,) metres.
        rest_height: Height of the centre of mass before the attempt, metres.
    """
    phase, times = streams["phase"], streams["timestamp"]
    closed = np.flatnonzero(phase == Phase.CLOSE)
    if not len(closed):
        return Measurements()
    both = np.asarray(touching(streams).all(axis=1))
    height = target_com(streams, object_com)[:, 2] - rest_height
    start, end = _in_hand(streams, closed[-1]), _in_hand(streams, len(phase) - 1)
    slip = apply(end, object_com) - apply(start, object_com)
    out = Measurements(
        lift_height=float(height[phase != Phase.SHAKE][-1]),
        slip_distance=length(slip),
        slip_angle=length(rotation_vector(product(end[:3, :3], start[:3, :3].T))),
        shake_level=_survived(streams, both),
        loss_time=float(times[both][-1]) if both.any() and not both[-1] else math.nan,
    )
    hold = phase == Phase.HOLD
    if not hold.any():
        return out
    depth = np.where(streams["tactile_body"] == Label.TARGET, streams["tactile_depth"], np.nan)
    period = float(times[1] - times[0])
    return dataclasses.replace(
        out,
        min_grip_force=float(pad_normal_force(streams)[hold].min()),
        hold_duration=float(both[hold].sum() * period),
        max_penetration=float(np.max(np.nan_to_num(depth[hold]), initial=0.0)),
        contact_area=_contact_area(streams, int(np.flatnonzero(hold)[-1])),
    )


def judge(
    streams: Streams, object_com: Array, rest_height: float, thresholds: LabelConfig
) -> Outcome:
    """Return the outcome of an attempt in which the gripper closed.

    Success means that, at the end of the hold, both pads touch the target and its centre of mass
    is at least ``min_lift`` above its rest. The target must also stay in the hand through a shake
    of ``min_shake``, and its grip force and its slip in the hand must be within the thresholds.
    """
    phase, both = streams["phase"], np.asarray(touching(streams).all(axis=1))
    height = target_com(streams, object_com)[:, 2] - rest_height
    up = both & (height >= thresholds.min_lift)
    held = np.flatnonzero(phase == Phase.HOLD)
    if len(held) and up[held[-1]]:
        return _judge_held(measure(streams, object_com, rest_height), thresholds)
    if height[-1] + rest_height < FELL_OFF:
        return Outcome.LEFT_WORKSPACE
    if not both.any():
        return Outcome.NO_CONTACT
    lifted = np.flatnonzero(phase == Phase.LIFT)
    return Outcome.LOST_IN_HOLD if len(lifted) and up[lifted[-1]] else Outcome.LOST_IN_LIFT


def _judge_held(measured: Measurements, thresholds: LabelConfig) -> Outcome:
    if measured.shake_level < thresholds.min_shake:
        return Outcome.LOST_IN_SHAKE
    firm = measured.min_grip_force >= thresholds.min_grip_force
    steady = (
        _within(measured.slip_distance, thresholds.max_slip_distance)
        and _within(measured.slip_angle, thresholds.max_slip_angle)
    )  # fmt: skip
    return Outcome.SUCCESS if firm and steady else Outcome.UNSTABLE


def _within(value: float, bound: float | None) -> bool:
    return bound is None or value <= bound


def _survived(streams: Streams, both: NDArray[np.bool_]) -> float:
    """Return the highest shake level that the target survived; 0 if it survived none.

    It survives a level if both pads touch it at the end of that level and of all lower ones.
    """
    levels = streams["shake_level"]
    survived = 0.0
    for level in np.unique(levels[levels > 0]):
        if not both[levels == level][-1]:
            break
        survived = float(level)
    return survived


def _contact_area(streams: Streams, record: int) -> float:
    """Return the area (m2) that the target's contact points span on a pad, mean of both pads."""
    areas = []
    for pad in range(2):
        on_target = streams["tactile_body"][record, pad] == Label.TARGET
        points = streams["tactile_position"][record, pad][on_target][:, [0, 2]]
        hull = cv2.convexHull(points) if len(points) > 2 else None
        areas.append(cv2.contourArea(hull) if hull is not None else 0.0)
    return float(np.mean(areas))


def _in_hand(streams: Streams, i: int) -> Array:
    """Return ``T_tcp_object`` (4, 4) at record i."""
    T_world_tcp = pose_matrices(streams["tcp_pose"][i])
    return product(inverse(T_world_tcp), pose_matrices(streams["object_pose"][i, 0]))
