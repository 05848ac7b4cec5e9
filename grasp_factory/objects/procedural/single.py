"""Families of one part. Lengths are in metres; a gripper opens to 0.080 or 0.110."""

from __future__ import annotations

import numpy as np

from grasp_factory.objects.base import Part
from grasp_factory.objects.procedural.parts import Parts, between, box, cylinder, mesh, one_of
from grasp_factory.objects.unit_meshes import FRUSTUM_PERCENTS, PRISM_SIDES, RING_PERCENTS


def draw_box(rng: np.random.Generator) -> Parts:
    """Draw a box, from a bar to a block that is too wide for one gripper but not the other."""
    return (box((between(rng, 0.02, 0.16), between(rng, 0.015, 0.09), between(rng, 0.012, 0.065))),)


def draw_capsule(rng: np.random.Generator) -> Parts:
    """Draw a cylinder with round ends."""
    d = between(rng, 0.018, 0.06)
    return (Part(shape="capsule", size=(d, d, d + between(rng, 0.01, 0.12))),)


def draw_cylinder(rng: np.random.Generator) -> Parts:
    """Draw a cylinder, from a disc to a rod."""
    return (cylinder(between(rng, 0.015, 0.075), between(rng, 0.02, 0.18)),)


def draw_ellipsoid(rng: np.random.Generator) -> Parts:
    """Draw an egg, a pebble or a lens."""
    size = (between(rng, 0.03, 0.11), between(rng, 0.02, 0.075), between(rng, 0.02, 0.075))
    return (mesh("ellipsoid", size),)


def draw_frustum(rng: np.random.Generator) -> Parts:
    """Draw a cone without its tip."""
    d = between(rng, 0.03, 0.075)
    percent = one_of(rng, FRUSTUM_PERCENTS)
    return (mesh(f"frustum_{percent}", (d, d, between(rng, 0.025, 0.12))),)


def draw_prism(rng: np.random.Generator) -> Parts:
    """Draw a prism of three, five, six or eight sides."""
    d = between(rng, 0.025, 0.075)
    return (mesh(f"prism_{one_of(rng, PRISM_SIDES)}", (d, d, between(rng, 0.02, 0.14))),)


def draw_ring(rng: np.random.Generator) -> Parts:
    """Draw a ring or a piece of tube."""
    d = between(rng, 0.035, 0.11)
    percent = one_of(rng, RING_PERCENTS)
    return (mesh(f"ring_{percent}", (d, d, between(rng, 0.012, 0.06))),)


def draw_sphere(rng: np.random.Generator) -> Parts:
    """Draw a ball."""
    d = between(rng, 0.02, 0.075)
    return (Part(shape="sphere", size=(d, d, d)),)


def draw_wedge(rng: np.random.Generator) -> Parts:
    """Draw a ramp: a prism on a right triangle."""
    return (
        mesh(
            "wedge",
            (between(rng, 0.03, 0.12), between(rng, 0.02, 0.075), between(rng, 0.015, 0.07)),
        ),
    )
