"""The size of an object: the unit of its numbers, and whether a gripper can grasp it."""

from __future__ import annotations

import numpy as np

from grasp_factory.core.geometry import Array, Vector3
from grasp_factory.objects.importing.base import UnusableError

METRES = (0.01, 1.0)
"""Range of the bounding box's largest side, in the mesh's units, that is read as metres."""
MILLIMETRES = (20.0, 1000.0)
"""The same for millimetres. Between the two, inches and centimetres are equally likely."""
MIN_SIDE = 0.004
"""Metres. Thinner objects lie below the fingertips, and contacts have margins of 1 mm."""
MAX_SIDE = 1.0
"""Metres. An arm cannot place longer objects."""
WIDEST_GRIPPER = 0.2
"""Metres; no gripper opens wider. This check needs no chosen gripper."""
_ANGLES = np.radians(np.arange(0.0, 180.0, 0.25))


def guess_scale(largest: float) -> tuple[float, str]:
    """Return metres per unit for a mesh that states no unit, and a warning, which may be empty.

    Args:
        largest: largest side of the bounding box, in the mesh's units.

    Raises:
        UnusableError: if several units are equally likely, or no unit is likely.
    """
    if METRES[0] <= largest <= METRES[1]:
        return 1.0, ""
    if MILLIMETRES[0] <= largest <= MILLIMETRES[1]:
        return 0.001, f"taken as millimetres, for its largest side is {largest:.4g} units"
    raise UnusableError(
        f"its largest side is {largest:.4g} units: neither metres ({METRES[0]:g} to"
        f" {METRES[1]:g}) nor millimetres ({MILLIMETRES[0]:g} to {MILLIMETRES[1]:g});"
        " give its scale in objects.yaml, metres per unit"
    )


def sides(points: Array, normals: Array) -> Vector3:
    """Return the sides of a box around a convex solid, metres, ascending from its narrowest width.

    Args:
        points: corners of the solid, (n, 3) metres.
        normals: unit normals of its faces, (m, 3). The narrowest width is searched along
            these; a slightly narrower one between two edges can be missed.
    """
    widths = np.concatenate([np.ptp(points @ part.T, axis=0) for part in _chunks(normals)])
    narrowest = normals[int(np.argmin(widths))]
    across = np.linalg.svd(narrowest[None])[2][1:]  # two directions at right angles to it
    turned = np.column_stack([np.cos(_ANGLES), np.sin(_ANGLES)])
    flat = np.ptp((points @ across.T) @ turned.T, axis=0)
    best = int(np.argmin(flat))
    across_best = (best + len(_ANGLES) // 2) % len(_ANGLES)
    small, middle, large = sorted(
        (float(widths.min()), float(flat[best]), float(flat[across_best]))
    )
    return small, middle, large


def check_size(found: Vector3) -> None:
    """Refuse an object that no gripper can grasp.

    Raises:
        UnusableError: with the side that is too small or too large.
    """
    if found[0] < MIN_SIDE:
        raise UnusableError(f"it is {_mm(found[0])} thin, valid: {_mm(MIN_SIDE)} or more")
    if found[2] > MAX_SIDE:
        raise UnusableError(f"it is {_mm(found[2])} long, valid: up to {_mm(MAX_SIDE)}")
    if found[0] > WIDEST_GRIPPER:
        raise UnusableError(
            f"too large for any gripper: it is {_mm(found[0])} wide where it is narrowest, and"
            f" none here opens {_mm(WIDEST_GRIPPER)}"
        )


def check_grip(found: Vector3, widest: float) -> None:
    """Refuse an object too wide in every direction for a gripper that opens ``widest`` metres.

    Raises:
        UnusableError: with its narrowest width.
    """
    if found[0] > widest:
        raise UnusableError(
            f"too large for the gripper: it is {_mm(found[0])} wide where it is narrowest, and"
            f" the fingers open {_mm(widest)}"
        )


def grip_warnings(found: Vector3, widest: float) -> tuple[str, ...]:
    """Return a warning if an object can be grasped only when it stands on its side."""
    if found[1] <= widest:
        return ()
    return (f"lying flat it is {_mm(found[1])} wide, and the fingers open {_mm(widest)}",)


def _chunks(rows: Array) -> list[Array]:
    return np.array_split(rows, max(1, len(rows) // 256))


def _mm(metres: float) -> str:
    return f"{metres * 1e3:.4g} mm"
