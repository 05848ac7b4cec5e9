"""Elementary functions with identical bits on every processor and C library.

The sine functions of the C library and of NumPy have variants for FMA, AVX2 and AVX-512 whose last
bits differ. IEEE 754 defines the exact result of ``+ - * /``, of the square root and of rounding to
an integer, so the functions here use only these: range reduction, then a Taylor series. The errors
of sine, cosine, exp and log are at most 2 ulp, of angles at most 5 ulp
(``tests/core/test_elementary.py``). All code that computes stored bytes from a seed uses them.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import cache

import numpy as np
from numpy.typing import ArrayLike

from grasp_factory.core.linear import Array

LARGEST_ANGLE = 1e5
"""Radians: up to this angle the range reduction of sine and cosine loses no precision."""

# Pi / 2 and ln 2 as sums of several terms. The first terms end in zero bits, so their products with
# the small integers of a range reduction are exact (Cody and Waite, 1980).
_HALF_PI = (
    float.fromhex("0x1.921fb54400000p+0"),
    float.fromhex("0x1.0b4611a600000p-34"),
    float.fromhex("0x1.3198a2e037073p-69"),
)
_LN2 = (float.fromhex("0x1.62e42fee00000p-1"), float.fromhex("0x1.a39ef35793c76p-33"))

_ARCTANGENT = [(1.0, -1.0)[k % 2] / (2 * k + 1) for k in range(8, 0, -1)]
_EXPONENTIAL = [1.0 / math.factorial(k) for k in range(14, 0, -1)]
_LOGARITHM = [1.0 / (2 * k + 1) for k in range(11, 0, -1)]


def sincos(angle: ArrayLike) -> tuple[Array, Array]:
    """Return sine and cosine of angles in rad, any shape, up to ``LARGEST_ANGLE`` in size.

    The results for NaN are NaN.

    Raises:
        ValueError: for a larger angle.
    """
    x = np.asarray(angle, np.float64)
    largest = np.abs(x).max(initial=0.0)
    if largest > LARGEST_ANGLE:
        raise ValueError(f"angle {largest} rad is larger than {LARGEST_ANGLE:g}")
    quarter = np.rint(x * (2.0 / math.pi))
    r = x - quarter * _HALF_PI[0]
    r -= quarter * _HALF_PI[1]
    r -= quarter * _HALF_PI[2]
    z = r * r
    first, *others = _sine_and_cosine(x.ndim)
    series = first * z
    for coefficient in others:
        series += coefficient
        series *= z
    sine, cosine = r + r * series[0], 1.0 + series[1]
    with np.errstate(invalid="ignore"):  # NaN is not an integer
        turn = quarter.astype(np.int64)
    is_odd = (turn & 1).astype(np.bool_)
    return (
        np.where(is_odd, cosine, sine) * (1 - (turn & 2)),
        np.where(is_odd, sine, cosine) * (1 - (turn + 1 & 2)),
    )


@cache
def _sine_and_cosine(ndim: int) -> tuple[Array, ...]:
    """Return the coefficients (2, 1, ...) of both series, from the highest power to the lowest."""
    terms = ((math.factorial(2 * k + 1), math.factorial(2 * k)) for k in range(8, 0, -1))
    signs = (1.0, -1.0) * 4
    return tuple(
        np.array([sign / n for n in pair]).reshape(2, *(1,) * ndim)
        for sign, pair in zip(signs, terms, strict=True)
    )


def arctan2(y: ArrayLike, x: ArrayLike) -> Array:
    """Return the angle of points (x, y) in rad, within [-pi, pi]; 0 for the origin.

    The half-angle formula, applied three times, reduces the tangent to below 0.1; then the
    series of arctan converges fast.
    """
    y, x = np.asarray(y, np.float64), np.asarray(x, np.float64)
    high, wide = np.abs(y), np.abs(x)
    larger = np.maximum(high, wide)
    t = np.minimum(high, wide) / np.where(larger == 0.0, 1.0, larger)
    for _ in range(3):
        t = t / (1.0 + np.sqrt(1.0 + t * t))
    z = t * t
    angle = 8.0 * (t + t * (z * _horner(_ARCTANGENT, z)))
    angle = np.where(high > wide, math.pi / 2.0 - angle, angle)
    angle = np.where(x < 0.0, math.pi - angle, angle)
    return np.asarray(np.where(y < 0.0, -angle, angle))


def arccos(cosine: ArrayLike) -> Array:
    """Return the angles in rad, within [0, pi], of cosines within [-1, 1]."""
    c = np.asarray(cosine, np.float64)
    return arctan2(np.sqrt((1.0 - c) * (1.0 + c)), c)


def exp(x: ArrayLike) -> Array:
    """Return e to the power of ``x``, any shape; results must not be denormal or infinite."""
    x = np.asarray(x, np.float64)
    power = np.rint(x * (1.0 / _LN2[0]))
    r = x - power * _LN2[0] - power * _LN2[1]
    return np.asarray(np.ldexp(1.0 + r * _horner(_EXPONENTIAL, r), power.astype(np.int32)))


def log(x: ArrayLike) -> Array:
    """Return the natural logarithms of positive, finite numbers, any shape."""
    fraction, power = np.frexp(np.asarray(x, np.float64))
    is_small = fraction < math.sqrt(0.5)
    fraction = np.where(is_small, 2.0 * fraction, fraction)
    power = power - is_small
    s = (fraction - 1.0) / (fraction + 1.0)
    z = s * s
    series = 2.0 * s + 2.0 * s * (z * _horner(_LOGARITHM, z))
    return np.asarray(power * _LN2[0] + (power * _LN2[1] + series))


def normal(rng: np.random.Generator, size: int | tuple[int, ...]) -> Array:
    """Draw standard normal numbers, rounded to single precision.

    NumPy computes the tails of the distribution with the C library's logarithm, whose last bits
    differ between libraries. Rounding to single precision removes these bits.
    """
    return rng.standard_normal(size).astype(np.float32).astype(np.float64)


def _horner(coefficients: Sequence[float], x: Array) -> Array:
    """Return the values of a polynomial; the coefficient of the highest power is first."""
    total = np.full_like(x, coefficients[0])
    for coefficient in coefficients[1:]:
        total *= x
        total += coefficient
    return total
