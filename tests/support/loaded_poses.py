"""Readings of a force-torque sensor with a known matrix, tool and loads."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from grasp_factory.capture.calibration.load_identification import LoadedPose
from grasp_factory.signals.wrench import tool_load

ZERO = np.array([12.0, -3.0, 40.0, 0.5, -0.2, 0.1])
_CROSS_TALK = 0.002 * np.random.default_rng(1).standard_normal((6, 6))
MATRIX = np.diag([0.1, 0.1, 0.12, 0.01, 0.011, 0.009]) + _CROSS_TALK
MASS, COM = 0.82, np.array([0.003, -0.004, 0.061])


def loaded_poses(
    count: int, *, noise: float = 0.0, has_loads: bool = True, seed: int = 0
) -> list[LoadedPose]:
    """Return poses in random orientations.

    Args:
        count: how many.
        noise: Standard deviation of a mean reading, in raw units.
        has_loads: whether weights of up to 2 kg hang at random places.
        seed: of everything.
    """
    rng = np.random.default_rng(seed)
    found = []
    for R in Rotation.random(count, rng=rng):
        mass = float(rng.choice([0.0, 0.5, 1.0, 2.0])) if has_loads else 0.0
        at = rng.uniform(-0.1, 0.1, 3)
        wrench = tool_load(R.as_matrix(), MASS, COM) + tool_load(R.as_matrix(), mass, at)
        raw = np.linalg.solve(MATRIX, wrench) + ZERO + noise * rng.standard_normal(6)
        found.append(
            LoadedPose(
                quat_xyzw=tuple(R.as_quat()), raw=tuple(raw), load_mass=mass, load_com=tuple(at)
            )
        )
    return found
