"""The only package that knows PyBullet."""

from __future__ import annotations

from grasp_factory.world.client import Row, World
from grasp_factory.world.engine import DATA
from grasp_factory.world.sleep import put_to_sleep, wake

__all__ = ["DATA", "Row", "World", "put_to_sleep", "wake"]
