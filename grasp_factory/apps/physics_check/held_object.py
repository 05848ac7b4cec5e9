"""Forces and moments on a held object, against Newton's laws, from recorded streams alone."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from grasp_factory.apps.physics_check.figure import Figure, percentiles
from grasp_factory.core.enums import Phase
from grasp_factory.core.episode import Episode
from grasp_factory.core.geometry import Array, quat_xyzw_to_matrix
from grasp_factory.labels.force_balance import Indices, acceleration, pads_on_target
from grasp_factory.labels.rule import target_com, touching
from grasp_factory.robots import ROBOTS
from grasp_factory.signals import compensate_gravity

STILL = 0.005
"""Speed of the target's centre of mass, m/s, below which the target counts as at rest."""
CLEAR = 0.001
"""Height above its rest position, metres, above which the target has left the table."""
CENTIMETRE = 0.01
"""Lever, metres, of the moment that residuals are compared with."""


def at_rest(episodes: Iterable[Episode]) -> list[Figure]:
    """Compare the loads on pads and wrist with the weight of an object that is held at rest.

    The figures are in per cent of the weight.
    """
    pads: list[float] = []
    wrist: list[float] = []
    moments: list[float] = []
    for episode in episodes:
        records = _rest_records(episode)
        weight = _weight(episode)
        force, moment = _on_target(episode, records)
        up = np.array([0.0, 0.0, weight])
        pads.extend(100.0 * np.linalg.norm(force - up, axis=1) / weight)
        moments.extend(100.0 * np.linalg.norm(moment, axis=1) / (weight * CENTIMETRE))
        load = _external_load(episode, records)
        wrist.extend(100.0 * np.linalg.norm(load + up, axis=1) / weight)
    return [
        *percentiles("at rest: pads' force against weight", pads, {50: 1.0, 95: 5.0}),
        *percentiles("at rest: pads' moment about the COM, of weight x 1 cm", moments, {50: 5.0}),
        *percentiles("at rest: wrist less tool weight against weight", wrist, {50: 2.0}),
    ]


def in_motion(episodes: Iterable[Episode]) -> list[Figure]:
    """Compare the pads' force with m (a - g) at each step of lift and shake, in per cent of m g.

    The episodes must be recorded at every physics step. The acceleration is the second difference
    of the centre of mass, because the engine's integrator relates force and motion in this way.
    """
    residuals: list[float] = []
    for episode in episodes:
        streams = episode.streams
        com = _com(episode)
        moving = np.isin(streams["phase"], (Phase.LIFT, Phase.SHAKE))
        moving &= com[:, 2] > episode.columns["rest_height"] + CLEAR
        moving &= touching(streams).all(axis=1)
        moving[[0, -1]] = False
        # Step k moves the body from k - 1 to k with the force of k: its acceleration is centred
        # on k - 1.
        records = np.flatnonzero(moving)
        force, _ = _on_target(episode, records)
        weight = _weight(episode)
        mass = float(episode.columns["object_mass"])
        moved = acceleration(com, streams["timestamp"])[records - 1]
        expected = mass * moved + np.array([0.0, 0.0, weight])
        residuals.extend(100.0 * np.linalg.norm(force - expected, axis=1) / weight)
    return percentiles("lift and shake: pads' force against m (a - g)", residuals, {95: 10.0})


def _rest_records(episode: Episode) -> Indices:
    streams = episode.streams
    speed = np.zeros(len(streams["timestamp"]))
    if len(speed) > 1:
        speed = np.linalg.norm(np.gradient(_com(episode), streams["timestamp"], axis=0), axis=1)
    return np.flatnonzero((streams["phase"] == Phase.HOLD) & (speed < STILL))


def _com(episode: Episode) -> Array:
    return target_com(episode.streams, np.asarray(episode.columns["object_com"])[0])


def _weight(episode: Episode) -> float:
    return float(episode.columns["object_mass"]) * episode.spec.physics.gravity


def _rotations(episode: Episode, records: Indices) -> Array:
    return quat_xyzw_to_matrix(episode.streams["tcp_pose"][records, 3:])


def _on_target(episode: Episode, records: Indices) -> tuple[Array, Array]:
    """Return the pads' force (n, 3) and moment about the COM (n, 3) on the target, world frame."""
    return pads_on_target(episode.streams, _com(episode), records)


def _external_load(episode: Episode, records: Indices) -> Array:
    """Return the force (n, 3) on the wrist without the tool's weight, world frame."""
    robot = ROBOTS[episode.spec.robot]
    R = _rotations(episode, records)
    wrench = episode.streams["wrist_wrench"][records].astype(np.float64)
    gravity = (0.0, 0.0, -episode.spec.physics.gravity)
    rest = compensate_gravity(wrench, R, robot.tool_mass, robot.tool_com, gravity)
    return np.asarray(np.einsum("nij,nj->ni", R, rest[:, :3]))
