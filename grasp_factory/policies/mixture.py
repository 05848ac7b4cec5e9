"""The policy ``mixture``: one of several policies, drawn for each episode."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from grasp_factory.core.episode import GraspPlan, SceneView
from grasp_factory.core.serialization import check, to_plain
from grasp_factory.policies.base import Policy, inner_settings
from grasp_factory.policies.direct import DIRECT
from grasp_factory.policies.perturbed import PERTURBED

PARTS: Mapping[str, Policy] = {**DIRECT, PERTURBED.name: PERTURBED}
"""The policies that may be parts of a mixture, by name."""


@dataclass(frozen=True, slots=True, kw_only=True)
class MixtureParameters:
    """Settings of ``mixture``."""

    weights: Mapping[str, float] = field(default_factory=lambda: dict.fromkeys(DIRECT, 1.0))
    """Policy name to weight."""
    parameters: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    """Policy name to settings of that policy; missing keys take the policy's defaults."""

    def __post_init__(self) -> None:
        for name in self.weights:
            check(name in PARTS, "weights", name, ", ".join(PARTS))
        for name in self.parameters:
            check(name in self.weights, "parameters", name, ", ".join(self.weights))
        shares = list(self.weights.values())
        ok = len(shares) > 0 and min(shares) >= 0.0 and sum(shares) > 0.0
        check(ok, "weights", dict(self.weights), "names with weights >= 0, at least one above 0")
        # A recipe contains every setting, also those of the mixed policies.
        complete = {
            name: to_plain(
                inner_settings(PARTS[name], self.parameters.get(name, {}), f"parameters.{name}")
            )
            for name in self.weights
        }
        object.__setattr__(self, "parameters", complete)


def plan(view: SceneView, rng: np.random.Generator, settings: MixtureParameters) -> GraspPlan:
    """Return the plan of one policy, drawn by weight; the order of the names does not matter."""
    names = sorted(settings.weights)
    edges = np.cumsum([settings.weights[name] for name in names])
    drawn = int(np.searchsorted(edges, rng.random() * edges[-1], side="right"))
    part = PARTS[names[min(drawn, len(names) - 1)]]
    planned = part.plan(view, rng, part.settings(settings.parameters[part.name]))
    return GraspPlan(
        grasps=tuple(
            dataclasses.replace(grasp, proposer=grasp.proposer or part.name)
            for grasp in planned.grasps
        )
    )


MIXTURE = Policy(
    name="mixture",
    description="one of several policies, drawn by weight for each episode",
    parameters=MixtureParameters,
    plan=plan,
)
