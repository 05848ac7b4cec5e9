"""The table of policies that use no other policy; the others can use these.

A new policy is a row of the table.
"""

from __future__ import annotations

from collections.abc import Mapping

from grasp_factory.policies.antipodal import ANTIPODAL
from grasp_factory.policies.base import Policy
from grasp_factory.policies.top_down import TOP_DOWN
from grasp_factory.policies.uniform import UNIFORM

DIRECT: Mapping[str, Policy] = {policy.name: policy for policy in (UNIFORM, TOP_DOWN, ANTIPODAL)}
