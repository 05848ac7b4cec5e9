"""The zero of a force-torque sensor: a mean at rest, refused under load or in motion."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from grasp_factory.core.geometry import Array
from grasp_factory.core.serialization import check_range, normalise
from grasp_factory.errors import CaptureError


@dataclass(frozen=True, slots=True, kw_only=True)
class TareRule:
    """When a record counts as a sensor at rest without load."""

    samples: int = 100
    """Samples of the mean; the first ones of the record."""
    most_force_std: float = 0.5
    """N: a larger standard deviation of an axis is motion."""
    most_torque_std: float = 0.02
    """N m."""
    most_force_drift: float = 0.2
    """N: a larger difference between the first and the last quarter is motion."""
    most_torque_drift: float = 0.01
    """N m."""
    most_force: float = 2.0
    """N: a larger distance from the expected reading is load."""
    most_torque: float = 0.1
    """N m."""

    def __post_init__(self) -> None:
        """Check the values.

        Raises:
            ConfigError: naming the setting.
        """
        normalise(self)
        check_range(self, "samples", 8, 1_000_000)
        for kind, unit in (("force", "N"), ("torque", "N m")):
            for key in (f"most_{kind}_std", f"most_{kind}_drift", f"most_{kind}"):
                check_range(self, key, 0.0, 1e6, unit)


def tare_zero(
    raw: ArrayLike, matrix: ArrayLike, rule: TareRule, expected: ArrayLike | None = None
) -> Array:
    """Return the sensor's reading without load, (6,) in raw units.

    The first ``rule.samples`` samples are tested, as wrenches: each axis must hardly vary (a moving
    tool makes it vary), and must not drift (an object that is lowered makes it drift). A constant
    load does not show in the record alone. So with ``expected``, the zero of an earlier
    calibration, the mean must also lie near it.

    Args:
        raw: (N, 6) channels.
        matrix: (6, 6) newtons and newton metres per unit.
        rule: the bounds.
        expected: (6,) a zero from before, in raw units; None if there is none.

    Raises:
        CaptureError: for too few samples, motion, or load.
    """
    raw, matrix = np.asarray(raw, np.float64), np.asarray(matrix, np.float64)
    if raw.ndim != 2 or raw.shape[1] != 6 or len(raw) < rule.samples:
        got = f"got {len(raw)} samples, valid: {rule.samples} or more"
        raise CaptureError(f"tare: {got}; record longer, or lower the number of samples")
    used = raw[: rule.samples]
    if not np.isfinite(used).all():
        raise CaptureError("tare: values that are not finite; check the sensor's cable")
    wrench = used @ matrix.T
    quarter = max(len(used) // 4, 1)
    drift = np.abs(wrench[-quarter:].mean(axis=0) - wrench[:quarter].mean(axis=0))
    _check("moves", "varies by", wrench.std(axis=0), rule.most_force_std, rule.most_torque_std)
    _check("moves", "drifts by", drift, rule.most_force_drift, rule.most_torque_drift)
    zero = used.mean(axis=0)
    if expected is not None:
        load = np.abs((zero - np.asarray(expected, np.float64)) @ matrix.T)
        _check("is under load", "is away from its zero by", load, rule.most_force, rule.most_torque)
    return np.asarray(zero)


def _check(what: str, how: str, values: Array, most_force: float, most_torque: float) -> None:
    for part, most, name, unit in (
        (values[:3], most_force, "force", "N"),
        (values[3:], most_torque, "torque", "N m"),
    ):
        if part.max() > most:
            axis = "xyz"[int(part.argmax())]
            raise CaptureError(
                f"tare: the tool {what}: {name} {axis} {how} {part.max():.3g} {unit}, valid: up to"
                f" {most:g} {unit}; hold it still and free of contact, and record again"
            )
