"""Systematic errors of an inertial sensor: bias, scale, axes that are not square, temperature.

The model of a triad is ``true = matrix @ (raw - bias - slope * (temperature - reference))``. The
matrix has the scale factors on its diagonal and the non-orthogonality beside it.
"""

# ruff: noqa: PLC0415

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from grasp_factory.core.geometry import Array
from grasp_factory.core.optional import require
from grasp_factory.core.serialization import from_plain, normalise
from grasp_factory.core.vectors import Vector3
from grasp_factory.errors import UsageError

LOCAL_GRAVITY = 9.80665
"""m/s2, the standard value; between 9.78 at the equator and 9.83 at the poles."""
_SIX = 6
_MANY = 9
"""Positions that the nine unknowns of ``calibrate_by_gravity`` need."""
_LEAST_TEMPERATURES = 3.0
"""Kelvin that a record must span before a slope can be told."""
Matrix3 = tuple[Vector3, Vector3, Vector3]


@dataclass(frozen=True, slots=True, kw_only=True)
class TriadModel:
    """The systematic errors of three axes, in the unit u of their signal."""

    bias: Vector3 = (0.0, 0.0, 0.0)
    """u, at the reference temperature."""
    matrix: Matrix3 = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
    temperature_slope: Vector3 = (0.0, 0.0, 0.0)
    """u per kelvin."""
    reference_temperature: float = 25.0
    """Degrees Celsius."""

    def __post_init__(self) -> None:
        """Check the types.

        Raises:
            ConfigError: naming the field.
        """
        normalise(self)

    def correct(self, raw: ArrayLike, temperature: ArrayLike | None = None) -> Array:
        """Return signals without the errors, (N, 3).

        Args:
            raw: (N, 3).
            temperature: (N,) degrees Celsius, or one value; None for the reference. NaN also counts
                as the reference.
        """
        reference = self.reference_temperature
        warm = np.asarray(reference if temperature is None else temperature, np.float64)
        warm = np.where(np.isnan(warm), 0.0, warm - reference)
        drift = warm[..., None] * np.array(self.temperature_slope)
        return np.asarray(
            (np.asarray(raw, np.float64) - self.bias - drift) @ np.array(self.matrix).T
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class PositionFit:
    """A triad's model from still positions."""

    model: TriadModel
    rms: float
    """What is left of the deviation from gravity, m/s2."""
    positions: int


def static_bias(angular_velocity: ArrayLike) -> Vector3:
    """Return the bias of a gyroscope that lies still: the mean of (N, 3) rad/s.

    Raises:
        UsageError: without samples.
    """
    values = np.asarray(angular_velocity, np.float64)
    if values.ndim != 2 or not len(values):
        raise UsageError(f"static_bias: got shape {values.shape}, valid: (N, 3), N of 1 or more")
    x, y, z = values.mean(axis=0).tolist()
    return x, y, z


def calibrate_six_positions(readings: ArrayLike, gravity: float = LOCAL_GRAVITY) -> PositionFit:
    """Return an accelerometer's model from positions in which each axis points up and down.

    The sensor sits in a square block on a level table. So the direction of gravity is known in each
    position, and 12 unknowns follow from 18 equations by least squares.

    Args:
        readings: (P, 3) mean reading of each position, m/s2, in any order. Each of the six
            directions must be there; a direction may occur several times.
        gravity: m/s2 at the place.

    Raises:
        UsageError: if a direction is missing, or a position is not near an axis.
    """
    means = _positions(readings, _SIX)
    axis = np.abs(means).argmax(axis=1)
    along = means[np.arange(len(means)), axis]
    share = np.abs(along) / np.linalg.norm(means, axis=1)
    if (share < 0.9).any():
        raise UsageError(
            f"six positions: position {int(share.argmin())} is not along an axis; valid: each axis"
            " up and down, or 9 or more positions in any direction"
        )
    names = {f"{'+' if s > 0 else '-'}{'xyz'[k]}" for k, s in zip(axis, along, strict=True)}
    missing = [n for n in ("+x", "-x", "+y", "-y", "+z", "-z") if n not in names]
    if missing:
        raise UsageError(f"six positions: no position with {', '.join(missing)} up; valid: all six")
    true = np.zeros_like(means)
    true[np.arange(len(means)), axis] = np.sign(along) * gravity
    design = np.column_stack([means, -np.ones(len(means))])
    found = np.linalg.lstsq(design, true, rcond=None)[0]  # true = M raw - M bias
    matrix = np.asarray(found[:3].T, np.float64)
    bias = np.asarray(np.linalg.solve(matrix, found[3]), np.float64)
    rms = float(np.sqrt(((design @ found - true) ** 2).mean()))
    return PositionFit(model=_model(bias, matrix), rms=rms, positions=len(means))


def calibrate_by_gravity(readings: ArrayLike, gravity: float = LOCAL_GRAVITY) -> PositionFit:
    """Return an accelerometer's model from positions in any directions.

    In each position the corrected reading must have the length of gravity (Tedaldi, Pretto and
    Menegatti: A robust and easy to implement method for IMU calibration, ICRA 2014). The matrix is
    upper triangular: the sensor's x axis is that of the triad.

    Args:
        readings: (P, 3) mean reading of each position, m/s2; P of 9 or more, well spread.
        gravity: m/s2 at the place.

    Raises:
        UsageError: for fewer positions, or positions that leave an unknown open.
        MissingLibraryError: if SciPy is not installed.
    """
    means = _positions(readings, _MANY)
    require("scipy", extra="filters")
    from scipy.optimize import least_squares

    upper = np.triu_indices(3)

    def corrected(unknowns: Array) -> Array:
        matrix = np.zeros((3, 3))
        matrix[upper] = unknowns[3:]
        return np.asarray((means - unknowns[:3]) @ matrix.T)

    def deviation(unknowns: Array) -> Array:
        return np.asarray(np.linalg.norm(corrected(unknowns), axis=1) - gravity)

    start = np.concatenate([np.zeros(3), np.eye(3)[upper]])
    found = least_squares(deviation, start, x_scale="jac")
    values = np.linalg.svd(found.jac, compute_uv=False)
    if values[-1] < 1e-3 * values[0]:
        raise UsageError("positions: they are too alike; valid: 9 or more, in all directions")
    matrix = np.zeros((3, 3))
    matrix[upper] = found.x[3:]
    rms = float(np.sqrt((found.fun**2).mean()))
    return PositionFit(model=_model(found.x[:3], matrix), rms=rms, positions=len(means))


def with_temperature(
    model: TriadModel, still: ArrayLike, temperature: ArrayLike
) -> TriadModel | None:
    """Return a model with the slope of the bias over temperature, from a record at rest.

    Returns:
        None if the temperature was not measured, or hardly changes.

    Args:
        model: the model without a slope; its bias holds at the mean temperature of the record.
        still: (N, 3) readings at rest.
        temperature: (N,) degrees Celsius; NaN where it was not measured.
    """
    warm, values = np.asarray(temperature, np.float64), np.asarray(still, np.float64)
    known = np.isfinite(warm)
    if not known.any() or np.ptp(warm[known]) < _LEAST_TEMPERATURES:
        return None
    warm, values = warm[known], values[known]
    reference = float(warm.mean())
    slope = (warm - reference) @ (values - values.mean(axis=0)) / ((warm - reference) ** 2).sum()
    x, y, z = slope.tolist()
    return replace(model, temperature_slope=(x, y, z), reference_temperature=reference)


def _positions(readings: ArrayLike, least: int) -> Array:
    means = np.asarray(readings, np.float64)
    if means.ndim != 2 or means.shape[1] != 3 or len(means) < least:
        raise UsageError(f"positions: got shape {means.shape}, valid: (P, 3), P of {least} or more")
    if not np.isfinite(means).all() or not np.linalg.norm(means, axis=1).all():
        raise UsageError("positions: a reading is 0 or not finite; valid: gravity in each")
    return means


def _model(bias: Array, matrix: Array) -> TriadModel:
    plain = {"bias": bias.tolist(), "matrix": matrix.tolist()}
    return from_plain(TriadModel, plain, "model")
