"""Exporters: datasets in the formats of other tools. A new one is one file and one row below."""

from __future__ import annotations

from collections.abc import Mapping

from grasp_factory.core.plugins.entry_points import installed
from grasp_factory.errors import PluginError, UnknownNameError, lookup, shown
from grasp_factory.writers.exporters.article import ARTICLE
from grasp_factory.writers.exporters.base import (
    ExportContents,
    Exporter,
    ExportFolder,
    ExportJob,
    ExportPart,
    NoSettings,
)
from grasp_factory.writers.exporters.bop import BOP
from grasp_factory.writers.exporters.coco import COCO
from grasp_factory.writers.exporters.cornell import CORNELL
from grasp_factory.writers.exporters.diffusion_policy import DIFFUSION_POLICY
from grasp_factory.writers.exporters.gqcnn import GQCNN
from grasp_factory.writers.exporters.jacquard import JACQUARD
from grasp_factory.writers.exporters.lerobot import LEROBOT
from grasp_factory.writers.exporters.robomimic import ROBOMIMIC
from grasp_factory.writers.exporters.rosbag.formats import ROSBAG1, ROSBAG2
from grasp_factory.writers.exporters.sequences import SEQUENCES
from grasp_factory.writers.exporters.tfrecord import TFRECORD
from grasp_factory.writers.exporters.vgn import VGN
from grasp_factory.writers.exporters.webdataset import WEBDATASET
from grasp_factory.writers.exporters.ycb import YCB

KIND = "exporters"
"""Installed packages offer exporters as entry points of the group ``grasp_factory.exporters``."""

EXPORTERS: Mapping[str, Exporter] = {
    row.name: row
    for row in (
        ARTICLE,
        BOP,
        COCO,
        CORNELL,
        DIFFUSION_POLICY,
        GQCNN,
        JACQUARD,
        LEROBOT,
        ROBOMIMIC,
        ROSBAG1,
        ROSBAG2,
        SEQUENCES,
        TFRECORD,
        VGN,
        WEBDATASET,
        YCB,
    )
}

NOT_OFFERED: Mapping[str, str] = {
    "rlbench": (
        "its loader unpickles its files, wants five cameras, and needs PyRep; take robomimic or"
        " lerobot instead"
    )
}
"""Formats that were asked for, and why they are not offered."""


def exporter_named(name: str) -> Exporter:
    """Return the exporter of a format, of this package or of an installed one.

    Raises:
        UnknownNameError: listing the formats, or saying why a format is not offered.
        PluginError: if an installed package's exporter cannot be loaded.
    """
    if name in NOT_OFFERED:
        raise UnknownNameError(f"format {name} is not offered: {NOT_OFFERED[name]}")
    offered = {} if name in EXPORTERS else installed(KIND)
    if name not in offered:
        return lookup(EXPORTERS, "format", name)
    found = offered[name].load()
    if not isinstance(found, Exporter) or found.name != name:
        raise PluginError(
            f"{offered[name].entry_point.value}: got {shown(found)}, valid: an Exporter with the"
            f" name {name!r}"
        )
    return found


def all_exporters() -> list[Exporter]:
    """Return the exporters of this package, then those of installed packages."""
    more = sorted(set(installed(KIND)) - set(EXPORTERS))
    return [*EXPORTERS.values(), *map(exporter_named, more)]


__all__ = [
    "EXPORTERS",
    "NOT_OFFERED",
    "ExportContents",
    "ExportFolder",
    "ExportJob",
    "ExportPart",
    "Exporter",
    "NoSettings",
    "all_exporters",
    "exporter_named",
]
