"""The set ``procedural``: families of shapes with random parameters, unlimited in number."""

from __future__ import annotations

from grasp_factory.objects.procedural.generator import FAMILIES, GENERATOR, PROCEDURAL

__all__ = ["FAMILIES", "GENERATOR", "PROCEDURAL"]
