"""The only package that knows PyBullet."""

from __future__ import annotations

from grasp_factory.world.client import Row, World
from grasp_factory.world.engine import DATA

__all__ = ["DATA", "Row", "World"]
