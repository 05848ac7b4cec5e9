"""Closing the loop: a trained model chooses the grasps from which the next one learns.

``turn_flywheel`` makes rounds of generate, train and generate, with grasps that the model is unsure
about against random ones at equal budget. Needs the extra ``[train]``.
"""

from __future__ import annotations

from grasp_factory.flywheel.settings import ARMS, FlywheelSettings
from grasp_factory.flywheel.turning import turn_flywheel

__all__ = ["ARMS", "FlywheelSettings", "turn_flywheel"]
