"""A noise model for the pads' touch: gain, creep, hysteresis, noise, saturation, counts."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from grasp_factory.core.geometry import Array
from grasp_factory.signals.noise.number_checks import check_figures, digitise


@dataclass(frozen=True, slots=True, kw_only=True)
class TactileNoise:
    """The imperfections of a pad that reads forces and torques. Pairs are (N, N m)."""

    noise: tuple[float, float]
    """Standard deviation of one reading."""
    gain_spread: float
    """Standard deviation of a pad's gain about 1, drawn once per pad and seed."""
    creep: float
    """Share by which the reading of a constant load grows per decade of time, from 1 s on."""
    hysteresis: float
    """Half the width of the hysteresis loop, as a share of the load."""
    full_scale: tuple[float, float]
    resolution: tuple[float, float]
    """Per count; 0 for no quantisation."""

    def __post_init__(self) -> None:
        """Check the figures (``check_figures``)."""
        check_figures(self)


_ARM = 0.02
"""Lever, metres, that turns the force figures into torques; half a pad's size, assumed."""

PIEZORESISTIVE = TactileNoise(
    # Tekscan FlexiForce A201-25 (datasheet, typical performance): force range 111 N, repeatability
    # below 2.5 %, drift below 5 % per logarithmic time, hysteresis below 4.5 % of full scale. It
    # measures a normal force. Assumptions: shear and torque behave alike, the values are equal to
    # these bounds, and the repeatability is one sigma of the gain.
    full_scale=(111.0, 111.0 * _ARM),
    gain_spread=0.025,
    creep=0.05,
    hysteresis=0.045 / 2.0,
    # Assumptions: twelve bits over both signs, a noise of one count.
    noise=(111.0 / 2**11, 111.0 * _ARM / 2**11),
    resolution=(111.0 / 2**11, 111.0 * _ARM / 2**11),
)
"""Like pads with a layer of pressure-sensitive ink."""


def corrupt(
    noise: TactileNoise,
    wrench: ArrayLike,
    rate_hz: float,
    seed: int | np.random.SeedSequence,
) -> Array:
    """Return the wrenches that noisy pads would have measured.

    The order is: gain, ``creep``, ``lag``, white noise, counts, saturation.

    Args:
        noise: The pads, e.g. ``PIEZORESISTIVE``.
        wrench: (T, 2, 6) force N, torque N m, without noise; the pads are unloaded before it.
        rate_hz: Records per second.
        seed: The same seed yields the same noise. A longer series starts with the noise of a
            shorter one.
    """
    rng = np.random.default_rng(seed)
    load = np.asarray(wrench, np.float64)
    gain = 1.0 + noise.gain_spread * rng.standard_normal((load.shape[1], 1))
    felt = lag(creep(load * gain, noise.creep, rate_hz), noise.hysteresis)
    felt = felt + np.repeat(noise.noise, 3) * rng.standard_normal(load.shape)
    return digitise(felt, np.repeat(noise.resolution, 3), np.repeat(noise.full_scale, 3))


def creep(load: Array, share: float, rate_hz: float) -> Array:
    """Return a load after creep in a viscoelastic layer: each step of the load keeps growing.

    A step of dF at time s adds ``dF (1 + share log10(1 + (t - s) / 1 s))``: the logarithmic drift
    of the datasheets for a constant load, superposed in time (Boltzmann's principle). After the
    load is removed, the reading falls back at the same slow rate.

    Args:
        load: (T, ...); before the first record there is no load.
        share: Growth per decade of time, as a share of the step.
        rate_hz: Records per second.
    """
    if not share or not len(load):
        return load
    steps = np.diff(load, axis=0, prepend=np.zeros_like(load[:1]))
    growth = share * np.log10(1.0 + np.arange(len(load)) / rate_hz)
    since = np.subtract.outer(np.arange(len(load)), np.arange(len(load)))
    weight = np.where(since >= 0, growth[np.maximum(since, 0)], 0.0)
    return np.asarray(load + np.tensordot(weight, steps, axes=1))


def lag(load: Array, share: float) -> Array:
    """Return a load after hysteresis: below the load while it grows, above it while it falls.

    This is a play operator whose play is proportional to the load (the generalised play of
    Visintin, Differential Models of Hysteresis, 1994, III.2): the reading does not change as long
    as it is within ``share`` of the load. So an unloaded pad reads 0; with a play of constant width
    it would not.

    Args:
        load: (T, ...); before the first record there is no load.
        share: Half the loop's width as a share of the load.
    """
    low, high = load - share * np.abs(load), load + share * np.abs(load)
    out = np.empty_like(load)
    felt: Array = np.zeros_like(load[:1])
    for t in range(len(load)):
        felt = np.asarray(np.clip(felt, low[t : t + 1], high[t : t + 1]))
        out[t] = felt[0]
    return out


def carry_over(streams: Mapping[str, NDArray[Any]], wrench: ArrayLike) -> Array:
    """Return forces at the contact points that add up to the force of another wrench.

    The difference between the forces of the two wrenches is divided among the points of a pad in
    proportion to the points' forces. Points without contact stay NaN.

    Args:
        streams: ``tactile_force`` (T, 2, P, 3), and the ``tactile_wrench`` that it belongs to.
        wrench: The other wrench, (T, 2, 6).

    Returns:
        (T, 2, P, 3) newtons.
    """
    force = np.asarray(streams["tactile_force"], np.float64)
    size = np.linalg.norm(np.nan_to_num(force), axis=-1, keepdims=True)
    total = size.sum(axis=2, keepdims=True)
    part = np.divide(size, total, out=np.zeros_like(size), where=total > 0.0)
    before = np.asarray(streams["tactile_wrench"], np.float64)
    change = (np.asarray(wrench, np.float64) - before)[..., :3]
    return np.asarray(force + part * change[:, :, None, :])
