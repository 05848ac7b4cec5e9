"""Make a store again from an export, with every array that the format holds."""

from __future__ import annotations

from grasp_factory.curation.restore.listing import ExportFacts, list_export
from grasp_factory.curation.restore.restoring import Restored, restore

__all__ = ["ExportFacts", "Restored", "list_export", "restore"]
