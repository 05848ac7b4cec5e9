"""What an export has, of any format, by its record."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from grasp_factory.core.executors import SendMessage
from grasp_factory.core.executors.import_process import in_import_process
from grasp_factory.core.serialization import is_integer
from grasp_factory.curation.restore.exported import DAMAGE, read_record
from grasp_factory.errors import StoreError
from grasp_factory.writers.exporters import EXPORTERS
from grasp_factory.writers.exporters.export_record import RECORD


@dataclass(frozen=True, slots=True, kw_only=True)
class ExportFacts:
    """What is in an export."""

    format: str
    can_be_imported: bool
    episodes: int
    stores: tuple[str, ...]
    """Names of the stores that it was made of."""
    arrays: tuple[str, ...]
    """Arrays of the stores; the format may lack some of them."""
    labels: tuple[str, ...]
    """Names of added labels."""
    annotations: int
    """Episodes with annotations."""


def list_export(path: Path) -> ExportFacts:
    """Return what is in an export.

    Raises:
        UsageError: if it is no export.
        StoreError: if its record is damaged.
    """
    found: ExportFacts = in_import_process(_facts, path, path)
    return found


def _facts(path: Path, report: SendMessage) -> ExportFacts:
    _, record = read_record(path)
    try:
        exporter = EXPORTERS.get(_text(record["format"]))
        if not is_integer(record["episodes"]):
            raise ValueError("its number of episodes is no integer")
        return ExportFacts(
            format=record["format"],
            can_be_imported=bool(exporter and exporter.read_back),
            episodes=record["episodes"],
            stores=tuple(_text(store["name"]) for store in record["stores"]),
            arrays=tuple(map(_text, record["arrays"])),
            labels=tuple(record["labels"].keys()),
            annotations=len(record["annotations"]),
        )
    except DAMAGE as error:
        raise StoreError(f"{path / RECORD} is damaged: {error}") from None


def _text(value: Any) -> str:
    if not isinstance(value, str):
        raise TypeError(f"got {type(value).__name__}, valid: a text")
    return value
