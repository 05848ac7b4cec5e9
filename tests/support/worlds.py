"""Worlds of both renderers."""

from __future__ import annotations

import pytest

from grasp_factory.core.renderer import Renderer
from grasp_factory.errors import UsageError
from grasp_factory.simulation.world import World


def world_of(renderer: Renderer) -> World:
    """Return a world, or skip the test where its renderer cannot be loaded."""
    try:
        return World(renderer)
    except UsageError as error:
        pytest.skip(str(error))
