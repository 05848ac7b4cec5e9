"""Calibrate, tare and gravity-compensate the wrist's force-torque sensor, as with a real one.

A wrench is (..., 6): force N and torque N m about the sensor's origin, in the sensor's axes, which
are parallel to the TCP frame's. It is the load that the tool exerts on the sensor.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from grasp_factory.core.geometry import Array, quat_xyzw_to_matrix
from grasp_factory.errors import UsageError

GRAVITY = (0.0, 0.0, -9.81)
"""m/s2 in the world: the default of ``PhysicsConfig.gravity``."""


def calibrate(raw: ArrayLike, matrix: ArrayLike, bias: ArrayLike) -> Array:
    """Return wrenches from a sensor's raw channels: ``matrix @ (raw - bias)``.

    Makers of strain-gauge sensors state their calibration in this form. The identity and a zero
    bias do not change a simulated wrench. Another matrix (cross-talk, a wrong gain) makes it the
    wrench of a badly calibrated sensor.

    Args:
        raw: (T, 6) channels, in any unit.
        matrix: (6, 6) newtons and newton metres per unit.
        bias: (6,) reading without load.

    Returns:
        (T, 6) wrenches.

    Raises:
        UsageError: naming the array that has a wrong shape.
    """
    matrix, bias = np.asarray(matrix, np.float64), np.asarray(bias, np.float64)
    for name, array, shape in (("matrix", matrix, (6, 6)), ("bias", bias, (6,))):
        if array.shape != shape:
            raise UsageError(f"calibrate: {name} has shape {array.shape}, valid: {shape}")
    return np.asarray((np.asarray(raw, np.float64) - bias) @ matrix.T)


def tare(wrench: ArrayLike, window: slice | NDArray[np.bool_]) -> Array:
    """Return wrenches minus their mean over a window without load.

    That mean includes the tool's weight in the orientation that it has in the window. If the hand
    turns later, compensate gravity first.

    Args:
        wrench: (T, 6).
        window: The records without load: a slice, or a mask (T,).

    Raises:
        UsageError: if the window holds no record.
    """
    wrench = np.asarray(wrench, np.float64)
    unloaded = wrench[window]
    if not len(unloaded):
        raise UsageError(f"tare: no record of {len(wrench)} is in the window, valid: 1 or more")
    return np.asarray(wrench - unloaded.mean(axis=0))


def rotations(pose: ArrayLike) -> Array:
    """Return the rotation matrices (..., 3, 3) of poses (..., 7) or quaternions xyzw (..., 4).

    For ``tcp_pose`` they are ``R_world_sensor``: the sensor's axes are parallel to the TCP frame's.
    """
    return quat_xyzw_to_matrix(np.asarray(pose, np.float64)[..., -4:])


def tool_load(
    R_world_sensor: ArrayLike,
    tool_mass: float,
    tool_com: ArrayLike,
    gravity: ArrayLike = GRAVITY,
) -> Array:
    """Return the load of a tool alone on the sensor: its weight, acting at its centre of mass.

    Args:
        R_world_sensor: (..., 3, 3).
        tool_mass: kg beyond the sensor: ``dataset.attributes["robot"]["tool_mass"]``.
        tool_com: (3,) metres in the sensor's frame: ``dataset.attributes["robot"]["tool_com"]``.
        gravity: (3,) or (..., 3) m/s2 in the world. For a hand that accelerates without turning,
            pass gravity minus the acceleration of the tool's centre of mass.

    Returns:
        (..., 6): ``[f, com x f]`` with ``f = m R^T g``.
    """
    R, g = np.asarray(R_world_sensor, np.float64), np.asarray(gravity, np.float64)
    force = tool_mass * np.einsum("...ji,...j->...i", R, g)
    return np.concatenate([force, np.cross(np.asarray(tool_com, np.float64), force)], axis=-1)


def compensate_gravity(
    wrench: ArrayLike,
    R_world_sensor: ArrayLike,
    tool_mass: float,
    tool_com: ArrayLike,
    gravity: ArrayLike = GRAVITY,
) -> Array:
    """Return wrenches minus the tool's weight: at rest, the external load.

    In motion the result also contains the tool's inertial load. See ``tool_load`` for the
    arguments.

    Args:
        wrench: (..., 6) in the sensor's frame.
        R_world_sensor: (..., 3, 3), from ``rotations(streams["tcp_pose"])``.
        tool_mass: kg.
        tool_com: (3,) metres in the sensor's frame.
        gravity: (3,) or (..., 3) m/s2 in the world.

    Returns:
        (..., 6) in the sensor's frame.
    """
    load = tool_load(R_world_sensor, tool_mass, tool_com, gravity)
    return np.asarray(np.asarray(wrench, np.float64) - load)
