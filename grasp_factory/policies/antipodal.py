"""The policy ``antipodal``: 6-DoF antipodal grasps from the target's surface in depth images."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from grasp_factory.core.elementary import arccos, arctan2, sincos
from grasp_factory.core.episode import Grasp, GraspPlan, SceneView
from grasp_factory.core.geometry import Array, apply, inverse, rotation_about, transform
from grasp_factory.core.linear import length, norm, turned
from grasp_factory.core.serialization import check_range
from grasp_factory.policies.base import Policy
from grasp_factory.policies.clearance import is_hit, off_the_table, open_gripper
from grasp_factory.policies.closing_outcome import Grip, close_on
from grasp_factory.policies.contacts import antipodal_pairs
from grasp_factory.policies.occupied_columns import SolidColumns, object_points
from grasp_factory.policies.surface import Surface, joined, outline, seen_surface, walls_below
from grasp_factory.policies.top_down import TOP_DOWN, TopDownParameters

CONTACTS = 150
"""Number of contacts on the visible surface, and as many on the walls below its outline."""
SURFACE = 1500
"""Largest number of points of the visible surface, and as many of its walls."""
PAIRS = 50
"""Largest number of contact pairs for which poses are tried."""
ROLLS = (0.0, 0.6, -0.6)
"""Rotations about the closing axis, as shares of the largest that the tilt allows.

They are tried in this order until one fits.
"""
MARGIN = 0.004
"""Smallest distance between the open gripper and obstacles, metres.

It covers half the side of a solid column and the deviation of the arm from its path.
"""
RANKED = 8
"""Largest number of proposed grasps, the best first."""

# Coefficients of a logistic regression of success on 477 executed random candidates (92 % held),
# from 700 episodes of train blobs with the KUKA at 20 N; the area under the ROC curve is 0.82. Of
# 176 candidates with patches outside the friction cone, which are not proposed, 64 % held.
LOG_ODDS = 4.8
PER_ANGLE = -1.5
"""Per radian of the angle between the worse patch's normal and the closing axis."""
PER_SIZE = 6000.0
"""Per square metre of the smaller patch's area."""
LARGEST_SIZE = 4e-4
"""Square metres: larger patches count as this size; 98 % of them held. An iiwa pad has 9.7e-4."""
PER_DISTANCE = -38.0
"""Per metre of horizontal distance between the midpoint of the patches and the centroid."""
PER_TILT = -1.1
"""Per radian of the angle between the approach axis and straight down."""
PER_SPAN = -40.0
"""Per metre of distance between the patches.

Wide targets leave the pads little space for surfaces that the cameras do not see.
"""


@dataclass(frozen=True, slots=True, kw_only=True)
class AntipodalParameters:
    """Settings of ``antipodal``."""

    friction: float = 0.5
    """Coulomb coefficient; its arc tangent is the largest angle between a normal and the axis."""
    tilt_deg: float = 30.0
    """Largest angle between the approach axis and straight down, degrees."""
    finger_clearance: float = 0.008
    """Smallest distance between each pad and the target on the approach, metres."""
    opening_margin: float = 0.015
    """The same where the gripper can open far enough, metres."""

    def __post_init__(self) -> None:
        check_range(self, "friction", 0.05, 2.0)
        check_range(self, "tilt_deg", 0.0, 45.0, "degrees")
        check_range(self, "finger_clearance", 0.0, 0.05, "m")
        check_range(self, "opening_margin", 0.0, 0.05, "m")


def plan(view: SceneView, rng: np.random.Generator, settings: AntipodalParameters) -> GraspPlan:
    """Return antipodal grasps, the most likely to hold first.

    If the images show no antipodal pair that the gripper can reach, the grasps are those of
    ``top_down``, with its name as the proposer.
    """
    scene = _Scene.seen_in(view, settings)
    grasps = [] if scene is None else list(scene.grasps())
    if not grasps:
        fallback = TOP_DOWN.plan(view, rng, TopDownParameters()).grasps
        named = (dataclasses.replace(grasp, proposer=TOP_DOWN.name) for grasp in fallback)
        return GraspPlan(grasps=tuple(named))
    grasps.sort(key=lambda grasp: -grasp.score)
    return GraspPlan(grasps=tuple(grasps[:RANKED]))


@dataclass(frozen=True, slots=True)
class _Scene:
    """The target and the obstacles as the images show them."""

    view: SceneView
    settings: AntipodalParameters
    seen: Surface
    walls: Surface
    """Invisible surface, assumed to be vertical below the outline of the visible surface."""
    obstacles: Array
    """(N, 3) metres, world frame: points that fill all objects."""
    centroid: Array
    """(3,) metres, world frame: the target's centroid if it is solid below its visible surface."""

    @classmethod
    def seen_in(cls, view: SceneView, settings: AntipodalParameters) -> _Scene | None:
        """Return the scene of a view, or None if it shows too little of the target."""
        seen, edge = seen_surface(view), outline(view)
        known = np.vstack([seen.points, edge.points])
        if not len(known):
            return None
        walls = walls_below(edge)
        obstacles = SolidColumns.under(object_points(view)).points()
        return cls(view, settings, seen, walls, obstacles, SolidColumns.under(known).centroid())

    def grasps(self) -> Iterator[Grasp]:
        """Yield one grasp for each pair of contacts that the open gripper can reach."""
        settings, tilt = self.settings, math.radians(self.settings.tilt_deg)
        steepest = min(math.pi / 2.0, float(arctan2(settings.friction, 1.0)) + tilt)
        steep = self.seen.where(np.abs(self.seen.normals[:, 2]) <= sincos(steepest)[0])
        upright = float(sincos(tilt)[1])
        pairs = antipodal_pairs(
            joined([steep.thinned(CONTACTS), self.walls.thinned(CONTACTS)]),
            aim=self._aim(),
            longest=self.view.gripper.max_width - 2.0 * settings.finger_clearance,
            friction=settings.friction,
            steepest=tilt,
        )
        surface = joined([self.seen.thinned(SURFACE), self.walls.thinned(SURFACE)])
        for middle, closing in zip(pairs.middles[:PAIRS], pairs.axes[:PAIRS], strict=True):
            widest = float(arccos(min(1.0, upright / length(closing[:2]))))
            tried = (self._grasp(surface, middle, closing, roll * widest) for roll in ROLLS)
            found = next((grasp for grasp in tried if grasp is not None), None)
            if found is not None:
                yield found

    def _aim(self) -> Array:
        """Return the centroid (3,), metres, raised until the palm is above the visible surface."""
        under_palm = (
            float(self.seen.points[:, 2].max(initial=0.0)) - self.view.gripper.palm_distance
        )
        x, y, z = self.centroid
        return np.array([x, y, max(z, under_palm + 2.0 * MARGIN)])

    def _grasp(self, surface: Surface, middle: Array, closing: Array, roll: float) -> Grasp | None:
        """Return the grasp along a closing axis, or None if it is impossible.

        It is impossible if the pads, which are areas and not points, first touch the target at
        other places outside the friction cone, or if the open gripper does not fit around it.
        """
        gripper, settings = self.view.gripper, self.settings
        down = np.array(
            [closing[2] * closing[0], closing[2] * closing[1], closing[2] * closing[2] - 1.0]
        )
        approach = turned(rotation_about(closing, roll), down / norm(down))
        R = np.column_stack([np.cross(closing, approach), closing, approach])
        T = transform(R, middle)
        T[:3, 3] += approach * (off_the_table(T, gripper, gripper.max_width) / approach[2])
        grip = close_on(surface, T, gripper)
        if grip is None or grip.angle > arctan2(settings.friction, 1.0):
            return None
        if grip.span + 2.0 * settings.finger_clearance > gripper.max_width:
            return None
        width = min(grip.span + 2.0 * settings.opening_margin, gripper.max_width)
        T[:3, 3] += grip.shift * closing
        T[:3, 3] += approach * (off_the_table(T, gripper, width) / approach[2])
        if is_hit(open_gripper(gripper, width), apply(inverse(T), self.obstacles), MARGIN):
            return None
        score = log_odds(grip, self.centroid, approach)
        return Grasp(T_world_tcp=T, width=width, score=score)


def log_odds(grip: Grip, centroid: Array, approach: Array) -> float:
    """Return the log odds that a grasp holds: log(p / (1 - p)) of its probability p."""
    return float(
        LOG_ODDS
        + PER_ANGLE * grip.angle
        + PER_SIZE * min(grip.size, LARGEST_SIZE)
        + PER_DISTANCE * length((grip.middle - centroid)[:2])
        + PER_TILT * arccos(min(1.0, -approach[2]))
        + PER_SPAN * grip.span
    )


ANTIPODAL = Policy(
    name="antipodal",
    description="opposed contacts within the friction cone, tilted where that fits",
    parameters=AntipodalParameters,
    plan=plan,
)
