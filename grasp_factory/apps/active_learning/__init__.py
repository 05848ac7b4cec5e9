"""Closing the loop: a trained model chooses the grasps from which the next one learns.

``run_rounds`` makes rounds of generate, train and generate, with grasps that the model is unsure
about against random ones at equal budget. Needs the extra ``[train]``.
"""

from __future__ import annotations

from grasp_factory.apps.active_learning.round_loop import run_rounds
from grasp_factory.apps.active_learning.settings import ARMS, FlywheelSettings

__all__ = ["ARMS", "FlywheelSettings", "run_rounds"]
