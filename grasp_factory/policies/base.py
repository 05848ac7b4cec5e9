"""The interface of policies (a pure function from a view to ranked grasps), and shared helpers."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from grasp_factory.core.camera import deproject_pixels
from grasp_factory.core.elementary import sincos
from grasp_factory.core.episode import GraspPlan, SceneView
from grasp_factory.core.geometry import Array, apply, transform
from grasp_factory.core.serialization import from_plain
from grasp_factory.errors import ConfigError, GraspFactoryError

TIP_CLEARANCE = 0.005
"""Smallest distance between planned fingertips and the table, metres."""


class PolicyError(Exception):
    """A policy raised, or returned something else than grasps; the text says which."""


@dataclass(frozen=True, slots=True)
class Policy:
    """A method to choose grasps. It has no access to the simulator."""

    name: str
    description: str
    parameters: type[Any]
    """A frozen dataclass of the policy's settings; all fields have defaults.

    A field ``model`` is the SHA-256 of a trained model; datasets then contain this model.
    """
    plan: Callable[[SceneView, np.random.Generator, Any], GraspPlan]
    """Returns ranked grasps for a view, a random generator and an instance of ``parameters``."""

    def settings(self, plain: Mapping[str, Any]) -> Any:
        """Return ``parameters`` from plain data; missing keys take their defaults.

        Raises:
            ConfigError: naming the key, the value and the valid values.
        """
        return from_plain(self.parameters, plain, f"policy_parameters.{self.name}")


def checked_plan(
    policy: Policy, view: SceneView, rng: np.random.Generator, settings: Any
) -> GraspPlan:
    """Return what a policy plans for a view.

    Raises:
        PolicyError: if it raises, or returns no ``GraspPlan`` of finite poses (4, 4).
        GraspFactoryError, MemoryError, OSError: if the policy raises one.
    """
    try:
        plan: Any = policy.plan(view, rng, settings)
    except (GraspFactoryError, MemoryError, OSError):
        raise
    except (Exception, SystemExit) as error:
        what = f"{type(error).__name__}: {error}"
        raise PolicyError(f"policy {policy.name} raises {what}") from error
    if not isinstance(plan, GraspPlan):
        got = type(plan).__name__
        raise PolicyError(f"policy {policy.name} returns {got}, valid: a GraspPlan")
    for number, grasp in enumerate(plan.grasps):
        pose = np.asarray(grasp.T_world_tcp, np.float64)
        if pose.shape != (4, 4) or not np.isfinite(pose).all():
            got = f"shape {pose.shape}" if pose.shape != (4, 4) else "NaN or infinity"
            what = f"T_world_tcp of grasp {number} has {got}"
            raise PolicyError(f"policy {policy.name}: {what}, valid: a finite pose (4, 4)")
    return plan


def inner_settings(policy: Policy, plain: Mapping[str, Any], key: str) -> Any:
    """Return the settings of a policy that another policy uses, from plain data under ``key``.

    Raises:
        ConfigError: naming the key, the value and the valid values.
    """
    try:
        return from_plain(policy.parameters, plain)
    except ConfigError as error:
        raise ConfigError(f"{key}: {error}") from None


def target_points(view: SceneView) -> Array:
    """Return the target's visible points (K, 3), world frame, metres, over all cameras."""
    return visible_points(view, lambda labels: labels == view.target_label)


def visible_points(
    view: SceneView, chosen: Callable[[NDArray[np.uint8]], NDArray[np.bool_]]
) -> Array:
    """Return the visible points (K, 3) with chosen labels, world frame, metres, over all cameras.

    Args:
        view: The view of the scene.
        chosen: Returns for an array of labels which of them are chosen.
    """
    clouds = [np.zeros((0, 3))]
    for image in view.images.values():
        v, u = np.nonzero(chosen(image.segmentation))
        depth = image.depth[v, u].astype(np.float64)
        points = deproject_pixels(u, v, depth, image.intrinsics)
        clouds.append(apply(image.T_world_camera, points))
    return np.vstack(clouds)


def looking_down(x: float, y: float, z: float, yaw: float) -> Array:
    """Return ``T_world_tcp`` (4, 4) that approaches straight down and closes along ``yaw``."""
    sine, cosine = sincos(yaw)
    return transform(downward(np.array([cosine, sine])), (x, y, z))


def downward(closing: Array) -> Array:
    """Return the rotations (..., 3, 3) that approach straight down and close along ``closing``.

    Args:
        closing: Horizontal unit vectors (..., 2): x and y in the world frame.
    """
    R = np.zeros((*closing.shape[:-1], 3, 3))
    cosine, sine = closing[..., 0], closing[..., 1]
    R[..., 0, 0], R[..., 0, 1] = -sine, cosine
    R[..., 1, 0], R[..., 1, 1] = cosine, sine
    R[..., 2, 2] = -1.0
    return R
