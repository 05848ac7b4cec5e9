"""Versions of a store: take snapshots, compare versions, and say what a thing was made of."""

from grasp_factory.curation.versions.agreement import SnapshotReport, check_snapshot
from grasp_factory.curation.versions.comparing import compare
from grasp_factory.curation.versions.difference import Difference
from grasp_factory.curation.versions.taking import Taken, take_snapshot

__all__ = [
    "Difference",
    "SnapshotReport",
    "Taken",
    "check_snapshot",
    "compare",
    "take_snapshot",
]
