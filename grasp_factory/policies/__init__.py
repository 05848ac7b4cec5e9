"""Choose a grasp from images, without access to the simulator.

A new policy is one file and one row in ``direct.py``.
"""

from __future__ import annotations

from collections.abc import Mapping

from grasp_factory.policies.base import Policy
from grasp_factory.policies.direct import DIRECT
from grasp_factory.policies.learned import LEARNED
from grasp_factory.policies.mixture import MIXTURE
from grasp_factory.policies.perturbed import PERTURBED

POLICIES: Mapping[str, Policy] = {
    **DIRECT,
    **{policy.name: policy for policy in (PERTURBED, MIXTURE, LEARNED)},
}

__all__ = ["POLICIES", "Policy"]
