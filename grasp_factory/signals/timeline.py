"""Series of different rates on one timeline, with a mask of the instants that were matched.

Times are seconds and are compared as whole nanoseconds, as in ROS, so a slop of 0.1 is exact.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from grasp_factory.core.geometry import Array
from grasp_factory.errors import UsageError

Ticks = NDArray[np.int64]
_NS = 1e9


class Aligned(NamedTuple):
    """A series on another timeline."""

    values: NDArray[Any]
    """(K, ...); NaN, or 0 for whole numbers, where nothing matched."""
    matched: NDArray[np.bool_]
    """(K,): False where ``values`` is not valid."""


def nearest(times: ArrayLike, values: ArrayLike, at: ArrayLike, slop: float) -> Aligned:
    """Return the nearest sample for each instant, if it is within ``slop``.

    A sample may match several instants. If two samples are equally near, the earlier one is taken.

    Args:
        times: (N,) seconds, ascending.
        values: (N, ...) of any type.
        at: (K,) seconds, in any order.
        slop: Largest distance of a sample from an instant, seconds, inclusive.

    Raises:
        UsageError: for times that do not ascend.
    """
    ticks, values, wanted = ticks_of(times, "times"), np.asarray(values), nanoseconds(at)
    out = _nothing(len(wanted), values)
    if not len(ticks):
        return out
    after = np.clip(np.searchsorted(ticks, wanted), 0, len(ticks) - 1)
    before = np.maximum(after - 1, 0)
    index = np.where(np.abs(wanted - ticks[before]) <= np.abs(ticks[after] - wanted), before, after)
    out.matched[:] = np.abs(ticks[index] - wanted) <= slop_ticks(slop)
    out.values[out.matched] = values[index[out.matched]]
    return out


def linear(times: ArrayLike, values: ArrayLike, at: ArrayLike) -> Aligned:
    """Return a series interpolated linearly between its samples, without extrapolation.

    Use ``slerp`` for quaternions, ``interpolate_poses`` for poses and ``nearest`` for coded values.

    Args:
        times: (N,) seconds, ascending.
        values: (N, ...) numbers.
        at: (K,) seconds, in any order.

    Returns:
        Values in float64.

    Raises:
        UsageError: for times that do not ascend.
    """
    values = np.asarray(values, np.float64)
    out, (before, after, part) = _between(times, values, at)
    weight = part.reshape(-1, *[1] * (values.ndim - 1))
    # A step from the previous sample: exact at the samples, and for a constant series.
    out.values[out.matched] = values[before] + weight * (values[after] - values[before])
    return out


def slerp(times: ArrayLike, quat_xyzw: ArrayLike, at: ArrayLike) -> Aligned:
    """Return orientations interpolated at constant angular velocity, by the shorter rotation.

    Spherical linear interpolation (Shoemake 1985): ``q`` and ``-q`` count as the same orientation.

    Args:
        times: (N,) seconds, ascending.
        quat_xyzw: (N, ..., 4); any norm above 0.
        at: (K,) seconds, in any order.

    Returns:
        Unit quaternions in float64.

    Raises:
        UsageError: for times that do not ascend.
    """
    quats = np.asarray(quat_xyzw, np.float64)
    quats = quats / np.linalg.norm(quats, axis=-1, keepdims=True)
    out, (before, after, part) = _between(times, quats, at)
    a, b = quats[before], quats[after]
    b = np.where((a * b).sum(axis=-1, keepdims=True) < 0.0, -b, b)
    # Half the chord is the sine of half the angle: well conditioned for small angles.
    angle = 2.0 * np.arcsin(np.clip(np.linalg.norm(b - a, axis=-1, keepdims=True) / 2.0, 0.0, 1.0))
    w = part.reshape(-1, *[1] * (quats.ndim - 1))
    # sin(w angle) / sin(angle), with its limit w at angle 0; sinc(x) is sin(pi x) / (pi x).
    share_b = w * np.sinc(w * angle / np.pi) / np.sinc(angle / np.pi)
    share_a = (1.0 - w) * np.sinc((1.0 - w) * angle / np.pi) / np.sinc(angle / np.pi)
    q = share_a * a + share_b * b
    out.values[out.matched] = q / np.linalg.norm(q, axis=-1, keepdims=True)
    return out


def interpolate_poses(times: ArrayLike, poses: ArrayLike, at: ArrayLike) -> Aligned:
    """Return poses on another timeline: positions by ``linear``, orientations by ``slerp``.

    Args:
        times: (N,) seconds, ascending.
        poses: (N, ..., 7), position and quaternion xyzw.
        at: (K,) seconds, in any order.

    Raises:
        UsageError: for times that do not ascend.
    """
    poses = np.asarray(poses, np.float64)
    position, matched = linear(times, poses[..., :3], at)
    return Aligned(np.concatenate([position, slerp(times, poses[..., 3:], at).values], -1), matched)


def nanoseconds(seconds: ArrayLike, name: str = "time") -> Ticks:
    """Return seconds as whole nanoseconds.

    Raises:
        UsageError: for values that are not finite, such as the padding of a store's series.
    """
    seconds = np.asarray(seconds, np.float64)
    if not np.isfinite(seconds).all():
        raise UsageError(f"{name}: not finite, valid: finite seconds; a store's padding is trimmed "
                         "in an Episode")  # fmt: skip
    return np.round(seconds * _NS).astype(np.int64)


def ticks_of(times: ArrayLike, name: str) -> Ticks:
    """Return ascending seconds as whole nanoseconds.

    Raises:
        UsageError: for times that do not ascend.
    """
    ticks = nanoseconds(times, name)
    wrong = np.flatnonzero(np.diff(ticks) <= 0)
    if len(wrong):
        i = int(wrong[0])
        pair = np.asarray(times)[i : i + 2].tolist()
        raise UsageError(f"{name}: sample {i + 1} at {pair[1]} s follows one at {pair[0]} s; "
                         "valid: ascending times, a nanosecond or more apart")  # fmt: skip
    return ticks


def slop_ticks(slop: float) -> float:
    """Return a slop in nanoseconds; it may be infinite.

    Raises:
        UsageError: if it is negative or NaN.
    """
    if not slop >= 0.0:
        raise UsageError(f"slop {slop}: valid: 0 s or more")
    return slop if slop == float("inf") else round(slop * _NS)


def _nothing(count: int, values: NDArray[Any]) -> Aligned:
    """Return an alignment in which nothing is matched yet."""
    empty = np.zeros((count, *values.shape[1:]), values.dtype)
    if values.dtype.kind == "f":
        empty[:] = np.nan
    return Aligned(empty, np.zeros(count, np.bool_))


def _between(
    times: ArrayLike, values: Array, at: ArrayLike
) -> tuple[Aligned, tuple[NDArray[np.intp], NDArray[np.intp], Array]]:
    """Return an alignment, and for its matched instants the samples around them and the fraction.

    The samples are indices before and after an instant; the fraction is of the way between them.
    """
    ticks, wanted = ticks_of(times, "times"), nanoseconds(at)
    out = _nothing(len(wanted), values)
    if len(ticks):
        out.matched[:] = (ticks[0] <= wanted) & (wanted <= ticks[-1])
    wanted = wanted[out.matched]
    before = np.searchsorted(ticks, wanted, side="right") - 1
    after = np.minimum(before + 1, max(len(ticks) - 1, 0))
    part = (wanted - ticks[before]) / np.maximum(ticks[after] - ticks[before], 1)
    return out, (before, after, part)
