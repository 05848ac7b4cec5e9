"""Exporters: datasets in the formats of other tools. A new one is one file and one row below."""

from __future__ import annotations

from collections.abc import Mapping

from grasp_factory.writers.exporters.base import ExportContents, Exporter, ExportJob, NoSettings

EXPORTERS: Mapping[str, Exporter] = {}

__all__ = ["EXPORTERS", "ExportContents", "ExportJob", "Exporter", "NoSettings"]
