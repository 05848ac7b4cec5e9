"""The policies that look for themselves: the others build on them. A new one is a row below."""

from __future__ import annotations

from collections.abc import Mapping

from grasp_factory.policies.antipodal import ANTIPODAL
from grasp_factory.policies.base import Policy
from grasp_factory.policies.top_down import TOP_DOWN
from grasp_factory.policies.uniform import UNIFORM

DIRECT: Mapping[str, Policy] = {policy.name: policy for policy in (UNIFORM, TOP_DOWN, ANTIPODAL)}
