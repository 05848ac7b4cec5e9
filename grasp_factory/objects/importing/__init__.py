"""Import of a user's folder of meshes: read, checked, decomposed into convex parts and cached."""

from __future__ import annotations

from grasp_factory.objects.importing.base import FolderReport, ImportedObject, Refusal
from grasp_factory.objects.importing.importing import import_folder
from grasp_factory.objects.importing.report import import_report_text

__all__ = ["FolderReport", "ImportedObject", "Refusal", "import_folder", "import_report_text"]
