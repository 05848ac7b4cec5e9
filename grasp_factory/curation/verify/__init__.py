"""Is a store what was written, and making again what is not."""

from __future__ import annotations

from grasp_factory.verifying.problems import Problem, Report
from grasp_factory.verifying.repair import Repaired, repair
from grasp_factory.verifying.verification import verify

__all__ = ["Problem", "Repaired", "Report", "repair", "verify"]
