"""Families that consist of bars. Lengths are in metres; parts touch and do not overlap."""

from __future__ import annotations

import numpy as np

from grasp_factory.objects.procedural.parts import (
    ALONG_X,
    ALONG_Y,
    Parts,
    between,
    box,
    cylinder,
    mesh,
)


def draw_channel(rng: np.random.Generator) -> Parts:
    """Draw a U: a floor between two walls along y."""
    width, length = between(rng, 0.04, 0.1), between(rng, 0.02, 0.075)
    height, wall = between(rng, 0.025, 0.08), between(rng, 0.006, 0.015)
    side = (width - wall) / 2.0
    return (
        box((width - 2.0 * wall, length, wall), (0.0, 0.0, (wall - height) / 2.0)),
        box((wall, length, height), (-side, 0.0, 0.0)),
        box((wall, length, height), (side, 0.0, 0.0)),
    )


def draw_cross(rng: np.random.Generator) -> Parts:
    """Draw a plus: one bar along x and two arms along y."""
    bar, arm = between(rng, 0.05, 0.14), between(rng, 0.015, 0.05)
    width, depth = between(rng, 0.012, 0.035), between(rng, 0.012, 0.04)
    out = (width + arm) / 2.0
    return (
        box((bar, width, depth)),
        box((width, arm, depth), (0.0, -out, 0.0)),
        box((width, arm, depth), (0.0, out, 0.0)),
    )


def draw_dumbbell(rng: np.random.Generator) -> Parts:
    """Draw a bar along z with a thicker disc, round or hexagonal, at each end."""
    bar, length = between(rng, 0.012, 0.03), between(rng, 0.04, 0.1)
    d, thickness = bar * between(rng, 1.5, 2.5), between(rng, 0.012, 0.03)
    out = (length + thickness) / 2.0
    if rng.random() < 0.5:
        ends = [cylinder(d, thickness, (0.0, 0.0, z)) for z in (-out, out)]
    else:
        ends = [mesh("prism_6", (d, d, thickness), (0.0, 0.0, z)) for z in (-out, out)]
    return (cylinder(bar, length), *ends)


def draw_ell(rng: np.random.Generator) -> Parts:
    """Draw an L: a bar along x and an arm along y at its end."""
    bar, arm = between(rng, 0.05, 0.14), between(rng, 0.02, 0.09)
    width, depth = between(rng, 0.012, 0.04), between(rng, 0.012, 0.04)
    thickness = between(rng, 0.012, 0.04)
    return (
        box((bar, width, depth)),
        box((thickness, arm, depth), ((bar - thickness) / 2.0, (width + arm) / 2.0, 0.0)),
    )


def draw_hammer(rng: np.random.Generator) -> Parts:
    """Draw a handle along x that ends in a head along y: a block between two round faces."""
    handle, length = between(rng, 0.012, 0.026), between(rng, 0.07, 0.13)
    block = handle * between(rng, 1.0, 1.6)
    face, stub = block * between(rng, 0.7, 1.0), between(rng, 0.01, 0.035)
    x, out = (length + block) / 2.0, (block + stub) / 2.0
    return (
        cylinder(handle, length, turn=ALONG_X),
        box((block, block, block), (x, 0.0, 0.0)),
        cylinder(face, stub, (x, -out, 0.0), ALONG_Y),
        cylinder(face, stub, (x, out, 0.0), ALONG_Y),
    )


def draw_tee(rng: np.random.Generator) -> Parts:
    """Draw a T: a bar along x and a stem along y from its middle."""
    bar, stem = between(rng, 0.05, 0.12), between(rng, 0.03, 0.1)
    width, depth = between(rng, 0.012, 0.04), between(rng, 0.012, 0.04)
    thickness = between(rng, 0.012, 0.04)
    return (
        box((bar, width, depth)),
        box((thickness, stem, depth), (0.0, (width + stem) / 2.0, 0.0)),
    )


def draw_zed(rng: np.random.Generator) -> Parts:
    """Draw a Z: an upright along z with two flanges: one low on one side, one high on the other."""
    height, length = between(rng, 0.05, 0.1), between(rng, 0.02, 0.07)
    web, flange = between(rng, 0.012, 0.03), between(rng, 0.015, 0.045)
    thickness = between(rng, 0.012, 0.02)
    x, z = (web + flange) / 2.0, (height - thickness) / 2.0
    return (
        box((web, length, height)),
        box((flange, length, thickness), (-x, 0.0, -z)),
        box((flange, length, thickness), (x, 0.0, z)),
    )
