"""The policy ``learned``: random grasps, ranked by the predictions of a trained model."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from grasp_factory.core.cache import is_digest
from grasp_factory.core.episode import Grasp, GraspPlan, SceneView
from grasp_factory.core.geometry import Array, apply, inverse
from grasp_factory.core.serialization import check, check_range
from grasp_factory.policies.base import Policy, target_points, visible_points
from grasp_factory.policies.candidates import Candidates, Region, draw_fitted, draw_open
from grasp_factory.policies.clearance import is_hit, open_gripper
from grasp_factory.policies.model_registry import find_model
from grasp_factory.policies.networks import GraspModel, grasp_inputs
from grasp_factory.policies.top_down import CLEARANCE, OFFSETS, THINNING, TopDownParameters

PREFERENCES: Mapping[str, Callable[[Array], Array]] = {
    "best": np.negative,
    "uncertain": np.abs,
    "random": np.zeros_like,
}
"""Functions from log odds (K,) to ascending sort keys; equal keys keep the order of drawing."""
SUREST = 13.8
"""Log odds are clipped to this absolute value: a probability of 1e-6 counts like 0."""


@dataclass(frozen=True, slots=True, kw_only=True)
class LearnedParameters:
    """Settings of ``learned``."""

    model: str = ""
    """SHA-256 of the file of an imported model; there is no default."""
    candidates: int = 64
    """Number of random grasps that the model ranks."""
    fitted: float = 0.5
    """Share of them whose centre and width fit the target; the others are like ``uniform``'s."""
    aim_noise: float = 0.035
    """Half the side of the square around the target's centre in which the others aim, metres."""
    prefer: str = "best"
    """The order of the grasps.

    ``best``: the most probable first; ``uncertain``: a probability near 0.5 first; ``random``.
    """
    ranked: int = 8
    """Largest number of proposed grasps."""

    def __post_init__(self) -> None:
        valid = "the SHA-256 of a trained model's file, which --model FILE imports and sets"
        check(is_digest(self.model), "model", self.model, valid)
        check_range(self, "candidates", 1, 4096)
        check_range(self, "fitted", 0.0, 1.0)
        check_range(self, "aim_noise", 0.0, 0.5, "m")
        check(self.prefer in PREFERENCES, "prefer", self.prefer, ", ".join(PREFERENCES))
        check_range(self, "ranked", 1, 256)


def plan(view: SceneView, rng: np.random.Generator, settings: LearnedParameters) -> GraspPlan:
    """Return random grasps in the order of preference; the score is the log odds of success.

    Grasps at which the gripper would touch another object are left out, unless all grasps would.

    Raises:
        ConfigError: if this machine has not imported the model.
        UsageError: if the model cannot be loaded.
    """
    points = target_points(view)
    if not len(points):
        return GraspPlan(grasps=())
    found = _free(view, _drawn(Region.around(points, view.gripper), rng, settings))
    odds = _log_odds(view, found, find_model(settings.model))
    order = np.argsort(PREFERENCES[settings.prefer](odds), kind="stable")[: settings.ranked]
    chosen = found.take(order)
    rows = zip(chosen.poses(), chosen.width.tolist(), odds[order].tolist(), strict=True)
    return GraspPlan(
        grasps=tuple(Grasp(T_world_tcp=T, width=width, score=score) for T, width, score in rows)
    )


def _drawn(region: Region, rng: np.random.Generator, settings: LearnedParameters) -> Candidates:
    """Return the fitted and the other candidates in random order."""
    fitted = round(settings.fitted * settings.candidates)
    gap = TopDownParameters()
    found = draw_open(region, rng, settings.candidates - fitted, settings.aim_noise).joined(
        draw_fitted(
            region, rng, fitted, aim=max(OFFSETS),
            clearance=gap.finger_clearance, margin=gap.opening_margin,
        )
    )  # fmt: skip
    return found.take(rng.permutation(len(found)))


def _free(view: SceneView, found: Candidates) -> Candidates:
    """Return the grasps that touch no other object, or all grasps if each of them touches one."""
    neighbors = visible_points(view, lambda labels: labels > view.target_label)[::THINNING]
    if not len(neighbors):
        return found
    rows = zip(found.poses(), found.width.tolist(), strict=True)
    hits = [
        is_hit(open_gripper(view.gripper, width), apply(inverse(T), neighbors), CLEARANCE)
        for T, width in rows
    ]
    return found if all(hits) else found.take(~np.array(hits))


def _log_odds(view: SceneView, found: Candidates, model: GraspModel) -> Array:
    """Return the log odds that each grasp holds, (K,)."""
    inputs = grasp_inputs(view, found.poses(), found.width, model.crop)
    return np.clip(model.log_odds(inputs), -SUREST, SUREST)


LEARNED = Policy(
    name="learned",
    description="drawn grasps in the order of a trained model (--model FILE)",
    parameters=LearnedParameters,
    plan=plan,
)
