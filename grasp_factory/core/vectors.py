"""Types of number tuples in records; no import of NumPy, so that a config loads fast."""

from __future__ import annotations

Vector3 = tuple[float, float, float]
QuatXyzw = tuple[float, float, float, float]
"""A quaternion, scalar last."""
