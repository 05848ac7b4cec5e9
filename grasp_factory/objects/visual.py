"""What an object looks like: mesh files for everything that is seen."""

from __future__ import annotations

from grasp_factory.objects.base import Compound, Part


def visual_parts(body: Compound) -> tuple[Part, ...]:
    """Return the parts that are seen."""
    return body.visual or body.parts
