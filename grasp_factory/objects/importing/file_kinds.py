"""Which files of a folder are imported, by the suffix of their names."""

from __future__ import annotations

MESH_SUFFIXES = ("obj", "stl", "ply")
SUFFIXES = (*MESH_SUFFIXES, "urdf")
