"""The contract of a policy, which every row of ``POLICIES`` keeps, for the gripper of every robot.

The checks are those of ``grasp-factory conformance``: see ``policy_checks``. Here some policies
promise less tilt than any policy may have.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterator

import numpy as np
import pytest
from support.scale import scaled
from support.tiny_models import tiny_model
from support.views import GRIPPERS

from grasp_factory.apps.conformance.policy_checks import (
    FARTHEST_TILT_DEG,
    POLICY_CHECKS,
    PolicyCase,
)
from grasp_factory.core.cache import VARIABLE, digest
from grasp_factory.core.enums import Label
from grasp_factory.core.episode import Grasp, GraspPlan, SceneView
from grasp_factory.core.gripper import Gripper
from grasp_factory.factory.plugin_rows import NoParameters
from grasp_factory.policies import POLICIES, Policy, model_registry
from grasp_factory.policies.base import TIP_CLEARANCE, looking_down, target_points

TILT_DEG = {
    **{"uniform": 0.0, "top_down": 0.0, "antipodal": 30.0, "perturbed": 50.0, "mixture": 30.0},
    "learned": 0.0,
}
"""Policies that by default promise less; for ``perturbed`` 4.9 sigma."""
NEEDED = {"learned": {"model": digest(tiny_model(0))}}
"""Settings that have no default."""


@pytest.fixture(autouse=True, scope="module")
def has_a_model(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv(VARIABLE, str(tmp_path_factory.mktemp("cache")))
        model_registry.keep(tiny_model(0))
        yield


@pytest.mark.parametrize("gripper", GRIPPERS.values(), ids=GRIPPERS)
@pytest.mark.parametrize("policy", POLICIES)
@pytest.mark.parametrize("check", POLICY_CHECKS)
def test_every_policy_passes(check: str, policy: str, gripper: Gripper) -> None:
    case = PolicyCase(
        policy=POLICIES[policy],
        gripper=gripper,
        settings=NEEDED.get(policy, {}),
        farthest_tilt_deg=TILT_DEG.get(policy, FARTHEST_TILT_DEG),
        seeds=scaled(6, 20),
    )
    assert POLICY_CHECKS[check](case) == ""


def central(view: SceneView, **change: float) -> Grasp:
    """Return a grasp on the middle of the target, with changes to its fields."""
    x, y, _ = target_points(view).mean(axis=0)
    z = view.gripper.tip_distance + TIP_CLEARANCE
    grasp = Grasp(T_world_tcp=looking_down(x, y, z, 0.0), width=view.gripper.max_width)
    return dataclasses.replace(grasp, **change)  # type: ignore[arg-type]


def seen(view: SceneView) -> bool:
    return len(target_points(view)) > 0


def good(view: SceneView, rng: np.random.Generator, settings: object) -> GraspPlan:
    return GraspPlan(grasps=(central(view),) if seen(view) else ())


def forgetful(view: SceneView, rng: np.random.Generator, settings: object) -> GraspPlan:
    width = np.random.default_rng().uniform(0.01, 0.05)
    return GraspPlan(grasps=(central(view, width=width),) if seen(view) else ())


def scribbling(view: SceneView, rng: np.random.Generator, settings: object) -> GraspPlan:
    view.images["front"].depth[0, 0] += 1.0
    return good(view, rng, settings)


def blind(view: SceneView, rng: np.random.Generator, settings: object) -> GraspPlan:
    T = looking_down(0.5, 0.0, 0.1, 0.0)
    return GraspPlan(grasps=(Grasp(T_world_tcp=T, width=0.05),))


def picky(view: SceneView, rng: np.random.Generator, settings: object) -> GraspPlan:
    many = len(target_points(view)) > 1
    return good(view, rng, settings) if many else GraspPlan(grasps=())


def greedy(view: SceneView, rng: np.random.Generator, settings: object) -> GraspPlan:
    shown = view.images["front"].segmentation >= Label.TARGET
    return blind(view, rng, settings) if shown.any() else GraspPlan(grasps=())


def wide(view: SceneView, rng: np.random.Generator, settings: object) -> GraspPlan:
    return GraspPlan(grasps=(central(view, width=1.0),) if seen(view) else ())


def unranked(view: SceneView, rng: np.random.Generator, settings: object) -> GraspPlan:
    scores = (1.0, 2.0) if seen(view) else ()
    return GraspPlan(grasps=tuple(central(view, score=score) for score in scores))


def stuck(view: SceneView, rng: np.random.Generator, settings: object) -> GraspPlan:
    return blind(view, rng, settings) if seen(view) else GraspPlan(grasps=())


FAULTY = dict(
    zip(
        POLICY_CHECKS,
        (forgetful, scribbling, blind, picky, greedy, wide, unranked, stuck),
        strict=True,
    )
)
"""For each check, a policy that fails it."""


def case_of(plan: Callable[..., GraspPlan]) -> PolicyCase:
    policy = Policy(name="mine", description="mine", parameters=NoParameters, plan=plan)
    return PolicyCase(policy=policy, gripper=GRIPPERS["panda"], seeds=1)


@pytest.mark.parametrize("check", POLICY_CHECKS)
def test_a_policy_that_breaks_a_rule_is_found(check: str) -> None:
    assert POLICY_CHECKS[check](case_of(good)) == ""
    try:
        fault = POLICY_CHECKS[check](case_of(FAULTY[check]))
    except ValueError as error:  # the view is read-only while it is checked
        fault = str(error)
    assert fault
    assert "\n" not in fault
