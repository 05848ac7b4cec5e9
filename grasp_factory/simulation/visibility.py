"""Visible share of each object: its pixels in the image, divided by those when it is alone."""

from __future__ import annotations

import itertools
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from grasp_factory.core.camera import Camera, Light, project
from grasp_factory.core.geometry import apply, inverse
from grasp_factory.simulation.images import Render, render
from grasp_factory.simulation.world import World

BORDER = 2
"""Margin around the box of an object that is rendered with it, pixels."""


def visible_shares(
    world: World, others: Sequence[int], objects: Sequence[int], camera: Camera, whole: Render
) -> NDArray[np.float32]:
    """Return the visible share of each object's pixels in an image, (M,).

    Each object is rendered alone for this. The share is 0 for an object outside the image.

    Args:
        world: Static bodies must be hidden in it.
        others: Moving bodies that are not objects.
        objects: Bodies.
        camera: The camera of the image.
        whole: The image.
    """
    hidden = {body: world.hide(body) for body in (*others, *objects)}
    shares = np.zeros(len(objects), np.float32)
    for i, body in enumerate(objects):
        window = _window(world, body, camera)
        if window is not None:
            world.show(body, hidden[body])
            alone = np.count_nonzero(render(world, window, Light()).zbuffer < 1.0)
            shares[i] = min(1.0, whole.pixels_of(body) / alone) if alone else 0.0
            world.hide(body)
    for body, looks in hidden.items():
        world.show(body, looks)
    return shares


def _window(world: World, body: int, camera: Camera) -> Camera | None:
    """Return the part of a camera's image that shows a body; None if no part does."""
    size = np.array([camera.intrinsics.width, camera.intrinsics.height])
    corners = np.array(list(itertools.product(*zip(*world.bounds(body), strict=True))))
    in_camera = apply(inverse(camera.T_world_camera), corners)
    if (in_camera[:, 2] < camera.near).all():
        return None
    low, high = np.zeros(2, int), size
    if (in_camera[:, 2] > camera.near).all():
        pixels = project(in_camera, camera.intrinsics.matrix())
        low = np.clip(np.floor(pixels.min(axis=0)).astype(int) - BORDER, 0, size)
        high = np.clip(np.ceil(pixels.max(axis=0)).astype(int) + BORDER + 1, 0, size)
    if (high <= low).any():
        return None
    left, top, width, height = (int(v) for v in (*low, *(high - low)))
    return camera.cropped(left, top, width, height)
