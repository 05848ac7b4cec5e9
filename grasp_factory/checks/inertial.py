"""The IMU at rest, and its noise model against its own densities."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from grasp_factory.checks.figure import Figure, at_most
from grasp_factory.episode import Episode
from grasp_factory.outcome import Phase

REST_S = 0.2
"""Seconds at the end of the hold that count as rest."""


def at_rest(episodes: Iterable[Episode]) -> list[Figure]:
    """Compare the specific force at rest with gravity, in per cent of it."""
    errors: list[float] = []
    for episode in episodes:
        held = episode.streams["timestamp"][episode.streams["phase"] == Phase.HOLD]
        if not len(held):
            continue
        times = episode.imu["timestamp"]
        rest = (times > held[-1] - REST_S) & (times <= held[-1])
        force = np.linalg.norm(episode.imu["specific_force"][rest].astype(np.float64), axis=1)
        gravity = episode.spec.physics.gravity
        errors.extend(100.0 * np.abs(force - gravity) / gravity)
    worst = float(np.median(errors)) if errors else np.nan
    return [at_most("IMU at rest against gravity", "median error", worst, 0.1, unit="%",
                    samples=len(errors))]  # fmt: skip
