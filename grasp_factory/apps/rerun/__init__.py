"""Rerun recordings of stored attempts: all that is stored of one, on one clock, in one viewer."""

from __future__ import annotations

from grasp_factory.apps.rerun.sdk import RRD, default_file, open_viewer, require_rerun

__all__ = ["RRD", "default_file", "open_viewer", "require_rerun"]
