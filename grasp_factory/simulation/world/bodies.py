"""Create bodies from parts (primitives and meshes) with given mass properties."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import Any

from grasp_factory.core.geometry import IDENTITY, Pose
from grasp_factory.errors import RecipeError
from grasp_factory.objects import MAX_PARTS, Compound, Part, visual_parts
from grasp_factory.simulation.world.engine import p

_TYPES: Mapping[str, int] = {
    "box": p.GEOM_BOX,
    "sphere": p.GEOM_SPHERE,
    "cylinder": p.GEOM_CYLINDER,
    "capsule": p.GEOM_CAPSULE,
}


def create_compound(
    client: int, body: Compound, pose: Pose, *, mass: float, scale: float, rgba: Sequence[float]
) -> int:
    """Create a compound with its own frame at ``pose`` and return the body.

    Raises:
        RecipeError: if it has too many parts, or a mesh file cannot be loaded.
    """
    seen = visual_parts(body)
    for parts in (body.parts, seen):
        if not 1 <= len(parts) <= MAX_PARTS:  # otherwise the engine crashes the process
            raise RecipeError(f"a body of {len(parts)} parts, valid: 1 to {MAX_PARTS}")
    try:
        shape = p.createCollisionShapeArray(
            **_arrays(body.parts, scale, "collision"), physicsClientId=client
        )
        visual = _create_visual(client, seen, scale, rgba)
        inertial = body.inertial_frame
        created: int = p.createMultiBody(
            mass,
            shape,
            visual,
            pose.position,
            pose.quat_xyzw,
            baseInertialFramePosition=_scaled(inertial.position, scale),
            baseInertialFrameOrientation=inertial.quat_xyzw,
            physicsClientId=client,
        )
    except p.error as error:
        raise RecipeError(f"a body cannot be made: {error}") from None
    moments = [mass * square * scale * scale for square in body.gyration_squared]
    p.changeDynamics(created, -1, localInertiaDiagonal=moments, physicsClientId=client)
    return created


def _create_visual(client: int, seen: Sequence[Part], scale: float, rgba: Sequence[float]) -> int:
    created: int = p.createVisualShapeArray(
        **_arrays(seen, scale, "visual"),
        rgbaColors=[list(rgba)] * len(seen),
        physicsClientId=client,
    )
    return created


def _arrays(parts: Sequence[Part], scale: float, kind: str) -> dict[str, Any]:
    """Return PyBullet's arrays for some parts; values that a type does not use are placeholders."""
    sizes = [_scaled(part.size, scale) for part in parts]
    is_mesh = [part.shape not in _TYPES for part in parts]
    frames = {
        f"{kind}FramePositions": [_scaled(part.pose.position, scale) for part in parts],
        f"{kind}FrameOrientations": [list(part.pose.quat_xyzw) for part in parts],
    }
    if len(parts) == 1 and parts[0].pose == IDENTITY:
        frames = {}  # with a frame, the engine would make a slower compound of the one shape
    return {
        "shapeTypes": [_TYPES.get(part.shape, p.GEOM_MESH) for part in parts],
        "radii": [size[0] / 2.0 for size in sizes],
        "halfExtents": [[side / 2.0 for side in size] for size in sizes],
        "lengths": [
            size[2] - (size[0] if part.shape == "capsule" else 0.0)  # between the caps' centres
            for part, size in zip(parts, sizes, strict=True)
        ],
        "fileNames": [
            _openable(Path(part.shape)) if mesh else ""
            for part, mesh in zip(parts, is_mesh, strict=True)
        ],
        "meshScales": sizes,
        **frames,
    }


@cache
def _openable(file: Path) -> str:
    """Return an ASCII name for a file: the engine crashes on other names."""
    if str(file).isascii():
        return str(file)
    return f"/proc/self/fd/{_directory(file.parent)}/{file.name}"


@cache
def _directory(path: Path) -> int:
    """Return a descriptor of a directory; it stays open, as the engine caches files by name."""
    return os.open(path, os.O_PATH)


def _scaled(vector: Sequence[float], scale: float) -> list[float]:
    return [scale * v for v in vector]
