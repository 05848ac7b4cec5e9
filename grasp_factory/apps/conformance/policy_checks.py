"""The checks of a policy, for the gripper of a robot."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from grasp_factory.apps.conformance.box_views import brick, lowest_corner, make_view, tilt_deg
from grasp_factory.core.enums import Label
from grasp_factory.core.episode import Grasp, SceneView
from grasp_factory.core.gripper import Gripper
from grasp_factory.policies import Policy
from grasp_factory.policies.base import TIP_CLEARANCE

FARTHEST_TILT_DEG = 60.0
"""How far from straight down a policy may approach."""
HEIGHTS = (0.012, 0.05, 0.15)
"""Heights of the bricks that are grasped, metres."""
ROUND = 1e-12
"""Differences that rounding makes."""


@dataclass(frozen=True, slots=True, kw_only=True)
class PolicyCase:
    """A policy to check."""

    policy: Policy
    gripper: Gripper
    settings: Mapping[str, Any] = field(default_factory=dict)
    """Settings that have no default, as plain data."""
    farthest_tilt_deg: float = FARTHEST_TILT_DEG
    """How far from straight down it may approach."""
    seeds: int = 20
    """Random generators that each height of brick is grasped with."""

    def grasps(self, view: SceneView, seed: int = 0) -> tuple[Grasp, ...]:
        """Return what the policy proposes."""
        settings = self.policy.settings(self.settings)
        return self.policy.plan(view, np.random.default_rng(seed), settings).grasps

    def view(self) -> SceneView:
        """Return a view of one brick."""
        return make_view(brick(0.55, 0.06, 0.4), self.gripper)


def _plain(grasps: tuple[Grasp, ...]) -> list[tuple[Any, ...]]:
    return [(grasp.T_world_tcp.tolist(), grasp.width, grasp.score) for grasp in grasps]


def _arrays(view: SceneView) -> list[NDArray[Any]]:
    images = [
        getattr(image, f.name) for image in view.images.values() for f in dataclasses.fields(image)
    ]
    return [*images, view.joint_positions, view.T_world_tcp]


def repeats(case: PolicyCase) -> str:
    """Check that the same view, random generator and settings give the same plan."""
    view = case.view()
    same = _plain(case.grasps(view, 3)) == _plain(case.grasps(view, 3))
    return "" if same else "two plans for one view and one seed differ: draw from rng alone"


def leaves_the_view(case: PolicyCase) -> str:
    """Check that the view is left as it is."""
    view = case.view()
    before = [array.copy() for array in _arrays(view)]
    for array in _arrays(view):
        array.flags.writeable = False
    case.grasps(view)
    pairs = zip(_arrays(view), before, strict=True)
    same = all(np.array_equal(array, was) for array, was in pairs)
    return "" if same else "an array of the view has changed: work on a copy"


def sees_nothing(case: PolicyCase) -> str:
    """Check that a target that nothing shows gives an empty plan."""
    found = case.grasps(make_view([], case.gripper))
    return f"{len(found)} grasps for no visible target, valid: none" if found else ""


def sees_a_pixel(case: PolicyCase) -> str:
    """Check that one visible pixel of the target is enough for a grasp."""
    view = case.view()
    image = view.images["front"]
    v, u = np.argwhere(image.segmentation == Label.TARGET)[0]
    image.segmentation[image.segmentation == Label.TARGET] = Label.TABLE
    image.segmentation[v, u] = Label.TARGET
    return "" if case.grasps(view) else "no grasp for a target of one pixel, valid: one or more"


def leaves_others_alone(case: PolicyCase) -> str:
    """Check that only the target is grasped."""
    other = [(T, size, Label.TARGET + 1) for T, size, _ in brick(0.5, 0.1, 0.0)]
    found = case.grasps(make_view(other, case.gripper))
    return f"{len(found)} grasps where only another object is visible, valid: none" if found else ""


def proposes_valid_grasps(case: PolicyCase) -> str:
    """Check that grasps are rigid, from above, off the table and within the gripper's width."""
    for height in HEIGHTS:
        view = make_view(brick(0.5, 0.0, 1.1, (0.08, 0.03, height)), case.gripper)
        for seed in range(case.seeds):
            grasps = case.grasps(view, seed)
            if not grasps:
                return f"no grasp for a brick of {height} m (seed {seed})"
            for grasp in grasps:
                if fault := next(_faults(grasp, case), ""):
                    return f"brick of {height} m, seed {seed}: {fault}"
    return ""


def _faults(grasp: Grasp, case: PolicyCase) -> Iterator[str]:
    T, widest = grasp.T_world_tcp, case.gripper.max_width
    R = T[:3, :3]
    is_rotation = np.allclose(R @ R.T, np.eye(3), rtol=0, atol=ROUND) and np.linalg.det(R) > 0
    if T.shape != (4, 4) or not (is_rotation and np.array_equal(T[3], [0.0, 0.0, 0.0, 1.0])):
        yield "T_world_tcp is no rigid pose (4, 4)"
        return
    tilt, most = tilt_deg(grasp), case.farthest_tilt_deg
    is_down = np.allclose(T[:3, 2], [0.0, 0.0, -1.0], rtol=0, atol=ROUND)
    if tilt > most + 1e-4 or (most == 0.0 and not is_down):
        yield f"it approaches {tilt:.1f} degrees from straight down, valid: up to {most:g}"
    low = lowest_corner(grasp, case.gripper)
    if not low >= TIP_CLEARANCE - ROUND:
        yield f"the open fingers reach down to {low:.4f} m, valid: {TIP_CLEARANCE} or more"
    if not 0.0 < grasp.width <= widest:
        yield f"width {grasp.width} m, valid: above 0, up to {widest}"
    if not math.isfinite(grasp.score):
        yield f"score {grasp.score}, valid: a finite number"


def ranks_them(case: PolicyCase) -> str:
    """Check that the grasp with the best score comes first."""
    scores = [grasp.score for grasp in case.grasps(case.view())]
    ok = scores == sorted(scores, reverse=True)
    return "" if ok else "the scores do not descend: put the best grasp first"


def follows_the_target(case: PolicyCase) -> str:
    """Check that grasps move with the target."""
    aims = []
    for y in (-0.1, 0.1):
        found = case.grasps(make_view(brick(0.55, y, 0.4), case.gripper), 5)
        if not found:
            return f"no grasp for a brick at y = {y} m"
        aims.append(found[0].T_world_tcp[:3, 3])
    moved = aims[1] - aims[0]
    ok = np.allclose(moved, [0.0, 0.2, 0.0], rtol=0, atol=0.006)
    shift = ", ".join(f"{value:.3f}" for value in moved)
    return "" if ok else f"a target 0.2 m farther along y moves the grasp by ({shift}) m"


POLICY_CHECKS: Mapping[str, Callable[[PolicyCase], str]] = {
    "the same view and seed give the same plan": repeats,
    "the view is left as it is": leaves_the_view,
    "a target that nothing shows gives an empty plan": sees_nothing,
    "one pixel of the target is enough for a grasp": sees_a_pixel,
    "other objects are not grasped": leaves_others_alone,
    "grasps are rigid, from above and off the table": proposes_valid_grasps,
    "the best grasp comes first": ranks_them,
    "grasps move with the target": follows_the_target,
}
"""The checks by what they check. Each returns what is wrong; empty if nothing is."""
