"""Which files of a folder are imported, by the suffix of their names."""

from __future__ import annotations

MESH_SUFFIXES = ("obj", "stl", "ply")
SUFFIXES = (*MESH_SUFFIXES, "urdf")
OTHER_SUFFIXES = frozenset(
    "3ds 3mf blend ctm dae fbx glb gltf iges igs off step stp usd usda usdc usdz wrl x3d".split()
)
"""Formats of shapes that are not read; a folder that holds some gets a warning."""
