"""Choose an object's mass, friction, inertia and colour from all sources."""

from __future__ import annotations

import dataclasses
import json

import numpy as np

from grasp_factory.core.cache import digest
from grasp_factory.core.geometry import Pose, Vector3, transform
from grasp_factory.objects.folder import FolderObject, Geometry
from grasp_factory.objects.importing.base import UnusableError
from grasp_factory.objects.importing.messages import Converted
from grasp_factory.objects.importing.object_source import ObjectSource
from grasp_factory.objects.importing.settings import DENSITY, FRICTION, MASS_RANGE, Settings
from grasp_factory.objects.solids import principal_axes

MASSES = (0.001, 5.0)
"""kg; the range that an arm of this size can lift."""
FRICTIONS = (0.01, 3.0)
SHAPE_STEP = 0.00503
"""About half a per cent. It divides no round number, which would be at a rounding boundary."""


def finished(
    source: ObjectSource, found: Converted, own: Settings, defaults: Settings
) -> tuple[FolderObject, tuple[str, ...]]:
    """Return an object with its physical properties, and all warnings about it.

    Each property comes from the first source that states it: the object's entry in
    ``objects.yaml``, the URDF, the defaults in ``objects.yaml``, the defaults of this package.

    Raises:
        UnusableError: if its mass would be outside of ``MASSES``.
    """
    warnings = [*source.warnings, *found.warnings]
    mass = round(_mass(source, found.volume, own, defaults, warnings), 6)
    item = FolderObject(
        family=source.family,
        shape_sha256=_shape_of(found),
        mass=mass,
        lateral_friction=_friction(source, own, defaults, warnings),
        color=found.color or (source.urdf and source.urdf.color) or _color_of(source.sha256),
        geometry=_geometry(source, found.geometry, warnings),
    )
    return item, tuple(warnings)


def _mass(
    source: ObjectSource, volume: float, own: Settings, defaults: Settings, warnings: list[str]
) -> float:
    said = source.urdf.mass if source.urdf else None
    if said is not None and not MASSES[0] <= said <= MASSES[1]:
        warnings.append(f"the URDF's mass, {said:.4g} kg, is left aside")
        said = None
    for mass, density in (
        (own.mass, own.density),
        (said, None),
        (defaults.mass, defaults.density),
    ):
        if mass is not None:
            return mass
        if density is not None:
            follows = density * volume
            if not MASSES[0] <= follows <= MASSES[1]:
                raise UnusableError(
                    f"with {density:g} kg/m3 it weighs {follows:.3g} kg, valid: {MASSES[0]:g} to"
                    f" {MASSES[1]:g} kg"
                )
            return follows
    return min(max(DENSITY * volume, MASS_RANGE[0]), MASS_RANGE[1])


def _friction(
    source: ObjectSource, own: Settings, defaults: Settings, warnings: list[str]
) -> float:
    said = source.urdf.friction if source.urdf else None
    if said is not None and not FRICTIONS[0] <= said <= FRICTIONS[1]:
        warnings.append(f"the URDF's friction, {said:.4g}, is left aside")
        said = None
    known = (own.friction, said, defaults.friction)
    return next((friction for friction in known if friction is not None), FRICTION)


def _geometry(source: ObjectSource, geometry: Geometry, warnings: list[str]) -> Geometry:
    """Return the geometry with the URDF's inertia, if a solid of this size can have it."""
    urdf = source.urdf
    if urdf is None or urdf.inertial is None or urdf.mass is None:
        return geometry
    com = np.array(urdf.inertial.com) * source.scale
    R, moments = principal_axes(urdf.inertial.inertia)
    squares = moments / urdf.mass * source.scale**2
    low, high = np.array(geometry.lower), np.array(geometry.upper)
    reach = float((np.maximum(high - com, com - low) ** 2).sum())  # to the farthest corner
    small, middle, large = np.sort(squares)
    inside = (low <= com).all() and (com <= high).all()
    if not (inside and small > 0.0 and small + middle >= large * (1 - 1e-6) and large <= reach):
        warnings.append(
            "the URDF's inertia is impossible for a solid of this size: computed instead"
        )
        return geometry
    pose = Pose.from_matrix(transform(R, com))
    x, y, z = (float(square) for square in squares)
    return dataclasses.replace(
        geometry, com=pose.position, axes_xyzw=pose.quat_xyzw, gyration_squared=(x, y, z)
    )


def _shape_of(found: Converted) -> str:
    """Return a digest of an object's shape, the same in any format, unit and orientation.

    It is the digest of ratios of its moments and volume, rounded so that a file's own rounding
    has no effect. Different shapes with equal ratios share a split, which does no harm.
    """
    small, middle, large = sorted(found.geometry.gyration_squared)
    figures = (small / large, middle / large, found.volume / large**1.5)
    return digest(json.dumps([round(figure / SHAPE_STEP) for figure in figures]).encode())


def _color_of(sha256: str) -> Vector3:
    """Return a colour derived from a digest: neither black nor white nor very bright."""
    red, green, blue = (round(0.25 + 0.6 * byte / 255.0, 3) for byte in bytes.fromhex(sha256)[:3])
    return red, green, blue
