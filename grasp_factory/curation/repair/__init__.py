"""Repair of a store: what ``verify`` finds is built again, and verified again."""

from __future__ import annotations

from grasp_factory.curation.repair.repair import RepairReport, repair

__all__ = ["RepairReport", "repair"]
