"""Exporters: datasets in the formats of other tools. A new one is one file and one row below."""

from __future__ import annotations

from collections.abc import Mapping

from grasp_factory.writers.exporters.article import ARTICLE
from grasp_factory.writers.exporters.base import (
    ExportContents,
    Exporter,
    ExportFolder,
    ExportJob,
    ExportPart,
    NoSettings,
)
from grasp_factory.writers.exporters.lerobot import LEROBOT
from grasp_factory.writers.exporters.sequences import SEQUENCES
from grasp_factory.writers.exporters.webdataset import WEBDATASET

EXPORTERS: Mapping[str, Exporter] = {
    row.name: row for row in (ARTICLE, LEROBOT, SEQUENCES, WEBDATASET)
}

__all__ = [
    "EXPORTERS",
    "ExportContents",
    "ExportFolder",
    "ExportJob",
    "ExportPart",
    "Exporter",
    "NoSettings",
]
