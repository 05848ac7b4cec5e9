"""Verification of a store: is everything in it as it was written?"""

from __future__ import annotations

from grasp_factory.curation.verify.problems import Problem, VerifyReport
from grasp_factory.curation.verify.verification import verify

__all__ = ["Problem", "VerifyReport", "verify"]
