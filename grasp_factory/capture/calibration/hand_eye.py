"""Where a camera sits on a robot: from pairs of the gripper's pose and the board's pose.

The equation is ``A X = X B`` with motions ``A`` of the gripper and ``B`` of the camera. Park and
Martin (Robot sensor calibration: solving AX=XB on the Euclidean group, IEEE Transactions on
Robotics and Automation 10(5), 1994) solve it in closed form. The same code runs with every version
of OpenCV; OpenCV 5 has no hand-eye calibration.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum
from itertools import combinations

import numpy as np

from grasp_factory.core.geometry import Array, inverse, rotation_vector, transform
from grasp_factory.errors import CaptureError

_LEAST_PAIRS = 3
_LEAST_TURN = np.radians(5.0)
"""A smaller turn between two poses says little about the axes."""
_LEAST_SPREAD = 0.02
"""Smallest second singular value of the axes, per largest: 0 if all turns are about one axis."""


class HandEyeSetup(Enum):
    """Where the camera is."""

    IN_HAND = 0
    """On the gripper, and the board stands in the world: the result is ``T_gripper_camera``."""
    TO_HAND = 1
    """In the world, and the gripper holds the board: the result is ``T_base_camera``."""


@dataclass(frozen=True, slots=True, kw_only=True)
class PosePair:
    """The gripper's pose, and the board's pose in the camera, at the same instant."""

    T_base_gripper: Array
    """(4, 4)"""
    T_camera_target: Array
    """(4, 4)"""


@dataclass(frozen=True, slots=True, kw_only=True)
class HandEyeFit:
    """A camera's pose, and how well the pairs agree on it."""

    setup: HandEyeSetup
    transform: Array
    """(4, 4) ``T_gripper_camera`` or ``T_base_camera``."""
    pairs: int
    position_rms: float
    """m: spread of the board's position, which must be the same in all pairs."""
    rotation_rms: float
    """rad: spread of the board's orientation."""


def calibrate_hand_eye(pairs: Sequence[PosePair], setup: HandEyeSetup) -> HandEyeFit:
    """Return the camera's pose on the gripper, or in the robot's base.

    Args:
        pairs: 3 or more; 10 to 20 with turns of 30 degrees or more about different axes are good.
        setup: where the camera is.

    Raises:
        CaptureError: for too few pairs, or turns about one axis only.
    """
    if len(pairs) < _LEAST_PAIRS:
        raise CaptureError(f"hand-eye: got {len(pairs)} pairs, valid: {_LEAST_PAIRS} or more")
    hands = np.array([pair.T_base_gripper for pair in pairs])
    targets = np.array([pair.T_camera_target for pair in pairs])
    moved = hands if setup is HandEyeSetup.IN_HAND else inverse(hands)
    found = _park_martin(moved, targets)
    boards = moved @ found @ targets
    position = boards[:, :3, 3] - boards[:, :3, 3].mean(axis=0)
    mean = _nearest_rotation(boards[:, :3, :3].sum(axis=0))
    turns = np.array([rotation_vector(mean.T @ board[:3, :3]) for board in boards])
    return HandEyeFit(
        setup=setup,
        transform=found,
        pairs=len(pairs),
        position_rms=float(np.sqrt((position**2).sum(axis=1).mean())),
        rotation_rms=float(np.sqrt((turns**2).sum(axis=1).mean())),
    )


def _park_martin(moved: Array, targets: Array) -> Array:
    """Return X with ``moved[i] X targets[i]`` constant."""
    motions = []
    for i, j in combinations(range(len(moved)), 2):
        A = inverse(moved[j]) @ moved[i]
        B = targets[j] @ inverse(targets[i])
        a, b = rotation_vector(A[:3, :3]), rotation_vector(B[:3, :3])
        # Near half a turn the sign of the axis is open.
        if _LEAST_TURN < np.linalg.norm(a) < np.pi - _LEAST_TURN:
            motions.append((A, B, a, b))
    axes = np.array([a for _, _, a, _ in motions]).reshape(-1, 3)
    values = np.linalg.svd(axes, compute_uv=False)
    if len(motions) < 2 or values[1] < _LEAST_SPREAD * values[0]:
        raise CaptureError(
            "hand-eye: the gripper turns about one axis, or hardly; valid: turns of 30 degrees or"
            " more about different axes"
        )
    # a = R b for each motion: the rotation is that between two sets of vectors.
    R = _nearest_rotation(np.sum([np.outer(a, b) for _, _, a, b in motions], axis=0))
    left = np.concatenate([A[:3, :3] - np.eye(3) for A, _, _, _ in motions])
    right = np.concatenate([R @ B[:3, 3] - A[:3, 3] for A, B, _, _ in motions])
    return transform(R, np.linalg.lstsq(left, right, rcond=None)[0])


def _nearest_rotation(M: Array) -> Array:
    """Return the rotation (3, 3) that is nearest to a matrix."""
    U, _, Vt = np.linalg.svd(M)
    return np.asarray(U @ np.diag([1.0, 1.0, np.linalg.det(U @ Vt)]) @ Vt)
