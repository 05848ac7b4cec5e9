"""Policies: what to aim at, from images alone. A new one is one file and one row below."""

from __future__ import annotations

from collections.abc import Mapping

from grasp_factory.policies.base import Policy
from grasp_factory.policies.top_down import TOP_DOWN
from grasp_factory.policies.uniform import UNIFORM

POLICIES: Mapping[str, Policy] = {policy.name: policy for policy in (UNIFORM, TOP_DOWN)}

__all__ = ["POLICIES", "Policy"]
