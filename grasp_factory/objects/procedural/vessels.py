"""Families of vessels. Lengths are in metres; parts touch and do not overlap.

Open vessels are rings of flat wedges on a floor of the same outline. They are turned so that a
flat side touches the handle.
"""

from __future__ import annotations

import numpy as np

from grasp_factory.objects.procedural.parts import (
    FLAT_AT,
    FLAT_TO_X,
    FLAT_WIDTH,
    ON_EDGE,
    Parts,
    between,
    box,
    cylinder,
    mesh,
    one_of,
)
from grasp_factory.objects.unit_meshes import ARCH_PERCENT


def draw_bottle(rng: np.random.Generator) -> Parts:
    """Draw a closed bottle: body, shoulder, neck and a cap."""
    d, body = between(rng, 0.03, 0.075), between(rng, 0.05, 0.12)
    percent = one_of(rng, (30, 45, 60))
    shoulder, neck, cap = between(rng, 0.01, 0.03), between(rng, 0.008, 0.02), 0.012
    mouth = d * percent / 100.0
    rim = body / 2.0 + shoulder
    return (
        cylinder(d, body),
        mesh(f"frustum_{percent}", (d, d, shoulder), (0.0, 0.0, (body + shoulder) / 2.0)),
        cylinder(mouth, neck, (0.0, 0.0, rim + neck / 2.0)),
        cylinder(1.2 * mouth, cap, (0.0, 0.0, rim + neck + cap / 2.0)),
    )


def draw_mug(rng: np.random.Generator) -> Parts:
    """Draw a mug with its handle towards x."""
    d, height = between(rng, 0.05, 0.078), between(rng, 0.06, 0.1)
    percent, floor = one_of(rng, (80, 90)), between(rng, 0.004, 0.008)
    out, up = between(rng, 0.022, 0.034), height * between(rng, 0.5, 0.75)
    handle = (out, up, d * between(rng, 0.6, 1.0) * FLAT_WIDTH)
    x = d / 2.0 * FLAT_AT + out / 2.0
    return (
        *_pot(d, height, percent, floor),
        mesh(f"arch_{ARCH_PERCENT}", handle, (x, 0.0, 0.0), ON_EDGE),
    )


def draw_pan(rng: np.random.Generator) -> Parts:
    """Draw a pan with its handle along x, at the rim."""
    d, height = between(rng, 0.06, 0.11), between(rng, 0.02, 0.045)
    floor = between(rng, 0.004, 0.008)
    length, thickness = between(rng, 0.05, 0.085), between(rng, 0.008, 0.014)
    width = d * between(rng, 0.6, 1.0) * FLAT_WIDTH
    at = (d / 2.0 * FLAT_AT + length / 2.0, 0.0, (height - thickness) / 2.0)
    return (*_pot(d, height, 90, floor), box((length, width, thickness), at))


def _pot(d: float, height: float, percent: int, floor: float) -> Parts:
    """Return the floor and the wall of an open vessel, centred at the origin."""
    wall = height - floor
    return (
        mesh("floor", (d, d, floor), (0.0, 0.0, -wall / 2.0), FLAT_TO_X),
        mesh(f"ring_{percent}", (d, d, wall), (0.0, 0.0, floor / 2.0), FLAT_TO_X),
    )
