"""Loading a URDF file."""

from __future__ import annotations

from pathlib import Path

from grasp_factory.core.geometry import Pose
from grasp_factory.errors import RecipeError
from grasp_factory.simulation.world.engine import muted, p
from grasp_factory.simulation.world.urdf import with_packages


def load_urdf(
    client: int, path: Path, pose: Pose, *, fixed: bool, file_inertia: bool, scale: float
) -> int:
    """Load a URDF with its own frame at ``pose`` and return the body.

    Raises:
        RecipeError: if the file cannot be loaded.
    """
    try:
        with muted(1):
            body: int = p.loadURDF(
                with_packages(path),
                pose.position,
                pose.quat_xyzw,
                useFixedBase=fixed,
                flags=p.URDF_USE_INERTIA_FROM_FILE if file_inertia else 0,
                globalScaling=scale,
                physicsClientId=client,
            )
    except (p.error, OSError) as error:
        raise RecipeError(f"{path.name} cannot be loaded: {error}") from None
    return body
