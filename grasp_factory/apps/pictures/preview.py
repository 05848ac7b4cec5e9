"""The preview: a grid of scenes before any grasp, which shows in seconds what a config makes."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable

import numpy as np

from grasp_factory.apps.pictures import painting
from grasp_factory.apps.pictures.painting import BgrImage
from grasp_factory.apps.pictures.tiles import grid
from grasp_factory.core.config.factory_config import FactoryConfig
from grasp_factory.errors import RecipeError, UsageError
from grasp_factory.factory.plugins import activate, with_plugins
from grasp_factory.sampling.spec import sample_spec
from grasp_factory.simulation.scene import build_scene, render_cameras, settle
from grasp_factory.simulation.world import World

TILE_WIDTH = 240
CAPTION = 20
"""Pixels below each tile."""
MOST = 400
"""Maximum scenes of a preview."""
SHAPE = 4 / 3
"""Approximate ratio of columns to rows."""


def draw_preview(config: FactoryConfig, n: int, on_scene: Callable[[], None]) -> BgrImage:
    """Return a grid of the first ``n`` scenes of a dataset, BGR, each with number and target.

    Among other objects, a line goes round the target. The objects are dropped and settle as for an
    attempt, and the first camera sees them. The tile of a recipe that cannot be built stays empty,
    and its caption gives the reason.

    Raises:
        UsageError: if ``n`` is less than 1 or more than ``MOST``.
        UnknownNameError: if the config contains an unknown name.
    """
    if not 1 <= n <= MOST:
        raise UsageError(f"{n} scenes: valid: 1 to {MOST}")
    config = with_plugins(config)
    activate(config)
    width, height = config.resolution
    size = (TILE_WIDTH, min(max(16, round(TILE_WIDTH * height / width)), 2 * TILE_WIDTH))
    small = dataclasses.replace(config, resolution=size)
    tiles = []
    with World(config.renderer) as world:
        for index in range(n):
            tiles.append(_tile(world, small, index))
            on_scene()
    return grid(tiles, math.ceil(math.sqrt(n * SHAPE)))


def _tile(world: World, config: FactoryConfig, index: int) -> BgrImage:
    spec = sample_spec(config, index)
    width, height = config.resolution
    picture: BgrImage = np.full((height, width, 3), painting.NOTHING, np.uint8)
    words = f"#{index} {spec.objects[0].object_id}"
    try:
        scene = build_scene(world, spec)
        settle(scene)
        _, render = render_cameras(scene)[next(iter(config.cameras))]
        picture = np.ascontiguousarray(render.rgb[..., ::-1])
        if len(spec.objects) > 1:
            painting.put_outline(picture, render.shows(scene.objects[0]))
    except RecipeError as error:
        words = f"#{index} {error}"
    strip: BgrImage = np.full((CAPTION, width, 3), painting.PAPER, np.uint8)
    painting.put_text(
        strip, words.encode("ascii", "replace").decode(), (2, CAPTION // 2), height=10
    )
    return np.vstack([picture, strip])
