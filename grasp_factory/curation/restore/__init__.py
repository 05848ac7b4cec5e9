"""Make a store again from an export, with every array that the format holds."""

from __future__ import annotations

from grasp_factory.curation.restore.restoring import Restored, restore

__all__ = ["Restored", "restore"]
