"""The only package that knows PyBullet."""

from __future__ import annotations

from grasp_factory.simulation.world.client import EngineRow, World
from grasp_factory.simulation.world.engine import DATA
from grasp_factory.simulation.world.sleep import put_to_sleep, wake

__all__ = ["DATA", "EngineRow", "World", "put_to_sleep", "wake"]
