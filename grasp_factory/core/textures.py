"""Procedural textures: a fixed list of ids; the image of a texture depends only on its id.

The textures are pale, because the renderer multiplies them with the colour of the body. Any
colour is possible, but the number of textures is fixed, because the engine keeps each one that it
loads.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Mapping

import numpy as np
from numpy.typing import NDArray

from grasp_factory.core.elementary import sincos
from grasp_factory.core.geometry import Array
from grasp_factory.errors import lookup

SIDE = 256
"""Width and height of a texture, pixels."""
NUMBERS = 8
"""Number of textures of each kind."""
DARKEST = 0.25
"""Smallest brightness of a texture, 0 to 1, so that the colour of the body remains visible."""

_V, _U = np.mgrid[0:SIDE, 0:SIDE] / SIDE


def texture_image(texture: str) -> NDArray[np.uint8]:
    """Return the image of a texture, RGB (256, 256, 3); every call returns the same image.

    Raises:
        UnknownNameError: if there is no such texture.
    """
    lookup(dict.fromkeys(TEXTURES), "texture", texture)
    kind = texture.partition("/")[0]
    seed = int.from_bytes(hashlib.sha256(texture.encode()).digest()[:8])
    rng = np.random.default_rng(seed)
    pattern = _KINDS[kind](rng)[..., None]
    light, dark = 1.0 - 0.15 * rng.random(3), DARKEST + 0.5 * rng.random(3)
    return np.asarray(np.rint(255.0 * (dark + (light - dark) * pattern)), np.uint8)


def _checker(rng: np.random.Generator) -> Array:
    tiles = int(rng.integers(2, 13))
    return np.asarray((np.floor(_U * tiles) + np.floor(_V * tiles)) % 2.0)


def _stripes(rng: np.random.Generator) -> Array:
    along, across = rng.integers(1, 10, 2)
    wave, _ = sincos(2.0 * np.pi * (along * _U + across * _V * rng.integers(0, 2)))
    return np.asarray(np.clip(0.5 + rng.uniform(1.0, 8.0) * wave, 0.0, 1.0))


def _dots(rng: np.random.Generator) -> Array:
    tiles, radius = int(rng.integers(3, 11)), rng.uniform(0.15, 0.45)
    u, v = _U * tiles % 1.0 - 0.5, _V * tiles % 1.0 - 0.5
    return np.asarray(u * u + v * v < radius * radius, np.float64)


def _bricks(rng: np.random.Generator) -> Array:
    rows = int(rng.integers(3, 9)) * 2
    row = np.floor(_V * rows)
    u, v = (_U * rows / 2.0 + row % 2 / 2.0), _V * rows
    joint = rng.uniform(0.04, 0.12)
    tone = rng.uniform(0.6, 1.0, (rows, rows))[row.astype(int), (np.floor(u) % rows).astype(int)]
    return np.asarray(np.where((u % 1.0 > joint / 2.0) & (v % 1.0 > joint), tone, 0.0))


def _cloud(rng: np.random.Generator) -> Array:
    """Return value noise of several octaves (Perlin's sum) that repeats smoothly at the edges."""
    coarsest = int(rng.integers(2, 5))
    whole = sum(_octave(rng, coarsest << k) / (1 << k) for k in range(5))
    assert isinstance(whole, np.ndarray)
    return _spread(whole)


def _wood(rng: np.random.Generator) -> Array:
    rings, bend = rng.integers(4, 12), rng.uniform(0.05, 0.3)
    grain = _U * rings + bend * rings * _octave(rng, 2)
    fine = _octave(rng, 64)
    return _spread(np.abs(grain % 1.0 - 0.5) * 2.0 + 0.25 * fine)


def _marble(rng: np.random.Generator) -> Array:
    veins = rng.integers(2, 6)
    turbulence = _cloud(rng)
    wave, _ = sincos(np.pi * (veins * (_U + _V) + 2.5 * turbulence))
    return np.asarray(np.sqrt(np.abs(wave)))


def _speckle(rng: np.random.Generator) -> Array:
    cells = 1 << int(rng.integers(4, 8))
    spots = rng.random((cells, cells)) > rng.uniform(0.1, 0.5)
    return spots.repeat(SIDE // cells, axis=0).repeat(SIDE // cells, axis=1).astype(np.float64)


def _octave(rng: np.random.Generator, cells: int) -> Array:
    """Return a grid of random values from 0 to 1, smoothly interpolated to (256, 256)."""
    grid = rng.random((cells, cells))
    at = np.arange(SIDE) * cells / SIDE
    low = at.astype(int)
    share = at - low
    share = share * share * (3.0 - 2.0 * share)
    high = (low + 1) % cells
    rows = grid[low] * (1.0 - share[:, None]) + grid[high] * share[:, None]
    return np.asarray(rows[:, low] * (1.0 - share) + rows[:, high] * share)


def _spread(values: Array) -> Array:
    """Return values scaled to the range from 0 to 1."""
    return np.asarray((values - values.min()) / np.ptp(values))


_KINDS: Mapping[str, Callable[[np.random.Generator], Array]] = {
    "bricks": _bricks,
    "checker": _checker,
    "cloud": _cloud,
    "dots": _dots,
    "marble": _marble,
    "speckle": _speckle,
    "stripes": _stripes,
    "wood": _wood,
}

TEXTURES: tuple[str, ...] = tuple(
    f"{kind}/{number}" for kind in _KINDS for number in range(NUMBERS)
)
"""All ids in a fixed order; random draws of a texture depend on this order."""
