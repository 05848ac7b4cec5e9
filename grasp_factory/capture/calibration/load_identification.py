"""Matrix, zero, tool weight and centre of mass of a force-torque sensor, from poses and loads.

At rest the sensor carries the tool's weight and that of a known load:
``M (raw - zero) = tool + load``. In ``M``, ``M zero``, the tool's mass and mass times centre of
mass, this equation is linear, so least squares finds all of them at once.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from grasp_factory.core.geometry import Array, skew
from grasp_factory.errors import CaptureError
from grasp_factory.signals.wrench import GRAVITY, rotations, tool_load

_LARGEST_CONDITION = 1e6
"""Of the scaled equations: beyond it a small error of a reading decides the result."""
_LEAST_MASS = 1e-4
"""kg: a lighter tool has no centre of mass that can be told."""


@dataclass(frozen=True, slots=True, kw_only=True)
class LoadedPose:
    """The sensor's mean reading at rest in one orientation, with a known load."""

    quat_xyzw: tuple[float, float, float, float]
    """R_world_sensor."""
    raw: tuple[float, float, float, float, float, float]
    """Channels, in the sensor's unit."""
    load_mass: float = 0.0
    """kg beyond the tool."""
    load_com: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Centre of mass of the load in the sensor's frame, m."""


@dataclass(frozen=True, slots=True, kw_only=True)
class LoadFit:
    """What poses with known loads tell about a sensor and its tool."""

    matrix: Array
    """(6, 6) N and N m per unit."""
    zero: Array
    """(6,) reading without any load, in raw units."""
    tool_mass: float
    """kg."""
    tool_com: Array
    """(3,) m in the sensor's frame; NaN for a tool without weight."""
    force_rms: float
    """N: what the fit leaves of the forces."""
    torque_rms: float
    """N m."""
    condition: float
    """Condition number of the scaled equations; a low one, below 1000, is good."""


def identify_load(
    poses: Sequence[LoadedPose],
    matrix: ArrayLike | None = None,
    gravity: ArrayLike = GRAVITY,
) -> LoadFit:
    """Return zero, tool and, unless it is given, the matrix of a sensor.

    Args:
        poses: With a known matrix 3 or more orientations without loads are enough. To find the
            matrix, 8 or more are necessary, with loads at several places.
        matrix: (6, 6) from the sensor's maker; None to find it.
        gravity: (3,) m/s2 in the world.

    Raises:
        CaptureError: if the poses leave a value open.
    """
    if matrix is None and not any(pose.load_mass for pose in poses):
        raise CaptureError("load identification: the matrix cannot be found without a known load")
    loads = _loads(poses, gravity)
    blocks, targets = [], []
    known = None if matrix is None else np.asarray(matrix, np.float64)
    for pose, load in zip(poses, loads, strict=True):
        raw, tool = np.array(pose.raw), _tool_columns(pose, gravity)
        if known is None:
            blocks.append(np.hstack([np.kron(np.eye(6), raw), -np.eye(6), -tool]))
            targets.append(load)
        else:
            blocks.append(np.hstack([np.eye(6), tool]))
            targets.append(known @ raw - load)
    unknowns, condition = _solve(np.vstack(blocks), np.concatenate(targets))
    found = known if known is not None else unknowns[:36].reshape(6, 6)
    offset, (mass, *moment) = unknowns[-10:-4], unknowns[-4:]
    zero = np.asarray(np.linalg.solve(found, offset), np.float64)
    com = np.array(moment) / mass if abs(mass) > _LEAST_MASS else np.full(3, np.nan)
    wrench = (np.array([pose.raw for pose in poses]) - zero) @ found.T
    tool = np.array([_tool_columns(pose, gravity) @ unknowns[-4:] for pose in poses])
    rest = wrench - tool - loads
    return LoadFit(
        matrix=found,
        zero=zero,
        tool_mass=float(mass),
        tool_com=com,
        force_rms=float(np.sqrt((rest[:, :3] ** 2).mean())),
        torque_rms=float(np.sqrt((rest[:, 3:] ** 2).mean())),
        condition=condition,
    )


def _loads(poses: Sequence[LoadedPose], gravity: ArrayLike) -> Array:
    R = rotations(np.array([pose.quat_xyzw for pose in poses]))
    return np.array(
        [
            tool_load(R[k], pose.load_mass, pose.load_com, gravity)
            for k, pose in enumerate(poses)
        ]
    )  # fmt: skip


def _tool_columns(pose: LoadedPose, gravity: ArrayLike) -> Array:
    """Return (6, 4): the wrench per kg of the tool, and per kg m of its mass times its centre."""
    weight = rotations(np.array(pose.quat_xyzw)).T @ np.asarray(gravity, np.float64)
    columns = np.zeros((6, 4))
    columns[:3, 0] = weight
    columns[3:, 1:] = -skew(weight)
    return columns


def _solve(equations: Array, targets: Array) -> tuple[Array, float]:
    """Return the unknowns, and the condition number of the equations with columns of length 1."""
    lengths = np.linalg.norm(equations, axis=0)
    scale = np.where(lengths > 0.0, lengths, 1.0)
    values = np.linalg.svd(equations / scale, compute_uv=False)
    is_short = len(equations) < equations.shape[1]
    condition = float("inf") if is_short or not values[-1] else float(values[0] / values[-1])
    if condition > _LARGEST_CONDITION:
        raise CaptureError(
            "load identification: the poses leave a value open; valid: orientations about several"
            " axes, and for the matrix known loads at several places"
        )
    return np.linalg.lstsq(equations / scale, targets, rcond=None)[0] / scale, condition
