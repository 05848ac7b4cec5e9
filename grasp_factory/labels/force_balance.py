"""Compare the hand's forces on the target with Newton's laws, from recorded streams alone."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from grasp_factory.core.enums import Label, Phase
from grasp_factory.core.episode import Streams
from grasp_factory.core.geometry import Array, quat_xyzw_to_matrix
from grasp_factory.core.linear import norm, turned, turned_back
from grasp_factory.labels.rule import target_com, touching

Indices = NDArray[np.signedinteger[Any]]


def pads_on_target(streams: Streams, com: Array, records: Indices) -> tuple[Array, Array]:
    """Return force (n, 3) N and moment about the COM (n, 3) N m of the pads on the target, world.

    Args:
        streams: The episode's streams.
        com: The target's centre of mass at every record of the streams, (T, 3) world, metres.
        records: The records to use, (n,).
    """
    tcp_pose, force, position, body, width = (
        streams[name][records]
        for name in (
            "tcp_pose", "tactile_force", "tactile_position", "tactile_body", "gripper_width"
        )
    )  # fmt: skip
    R = quat_xyzw_to_matrix(tcp_pose[:, 3:])
    on_target = (body == Label.TARGET)[..., None]
    force = np.where(on_target, -force.astype(np.float64), 0.0)
    points = np.where(on_target, position.astype(np.float64), 0.0)
    half = width.astype(np.float64)[:, None] / 2.0
    points[:, 0, :, 1] += half  # pad frames are half the width from the TCP, along y
    points[:, 1, :, 1] -= half
    offset = com[records] - tcp_pose[:, :3].astype(np.float64)
    in_hand = turned_back(R, offset)
    moment = np.cross(points - in_hand[:, None, None], force) * on_target
    total = turned(R, force.sum(axis=(1, 2)))
    return total, turned(R, moment.sum(axis=(1, 2)))


def acceleration(com: Array, times: Array) -> Array:
    """Return second differences (T, 3), m/s2, of points (T, 3); 0 at both ends.

    Args:
        com: Points, world, metres.
        times: Times of the records, evenly spaced, (T,) seconds.
    """
    out = np.zeros_like(com)
    if len(com) > 2:
        period = float(times[1] - times[0])
        out[1:-1] = (com[2:] - 2.0 * com[1:-1] + com[:-2]) / (period * period)
    return out


def force_residual(streams: Streams, object_com: Array, mass: float, gravity: float) -> float:
    """Return the mean error of the hand's force against m (a - g) in the hold, divided by m g.

    Only records at which both pads touch the target count; NaN without any.

    Args:
        streams: The episode's streams.
        object_com: Centre of mass in the object's own frame, (3,) metres.
        mass: Mass of the target, kg.
        gravity: Gravity of the simulation, m/s2.
    """
    held = (streams["phase"] == Phase.HOLD) & touching(streams).all(axis=1)
    held[[0, -1] if len(held) else []] = False  # the acceleration is not known there
    records = np.flatnonzero(held)
    if not len(records):
        return math.nan
    com = target_com(streams, object_com)
    force, _ = pads_on_target(streams, com, records)
    force += streams["hand_force"][records]
    up = np.array([0.0, 0.0, gravity])
    expected = mass * (acceleration(com, streams["timestamp"])[records] + up)
    return float(norm(force - expected).mean() / (mass * gravity))
