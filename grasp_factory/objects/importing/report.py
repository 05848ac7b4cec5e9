"""The report of an import, as ``grasp-factory objects DIR`` prints it."""

from __future__ import annotations

from collections.abc import Sequence

from grasp_factory.core.text_format import escaped
from grasp_factory.objects.importing.base import FolderReport, ImportedObject

HEADER = ("object", "size, mm", "mass, g", "parts", "split")

MAX_NAME = 60
"""Characters of an id in the table."""


def import_report_text(report: FolderReport) -> str:
    """Return a table of the usable objects with warnings, and a list of the refused files."""
    lines = [
        f"{len(report.usable)} usable, {len(report.refused)} refused",
        *(f"warning: {escaped(warning)}" for warning in report.warnings),
    ]
    if report.usable:
        lines += ["", *_table([HEADER, *(_row(item) for item in report.usable)], report.usable)]
    if report.refused:
        lines += ["", "Refused:"]
        for refusal in report.refused:
            lines.append(f"  {escaped(refusal.file)}: {escaped(refusal.reason)}")
    return "\n".join(lines)


def _row(item: ImportedObject) -> tuple[str, ...]:
    size = " x ".join(f"{side * 1e3:.0f}" for side in item.sides)
    name = escaped(item.object_id)
    if len(name) > MAX_NAME:
        name = f"{name[: MAX_NAME - 1]}…"
    return name, size, f"{item.mass * 1e3:.0f}", str(item.parts), item.split


def _table(rows: Sequence[tuple[str, ...]], items: Sequence[ImportedObject]) -> list[str]:
    widths = [max(len(row[i]) for row in rows) for i in range(len(HEADER))]
    lines = []
    for row, item in zip(rows, [None, *items], strict=True):
        cells = [row[0].ljust(widths[0])]
        cells += [cell.rjust(width) for cell, width in zip(row[1:], widths[1:], strict=True)]
        lines.append("  " + "  ".join(cells))
        lines += [f"      {escaped(warning)}" for warning in (item.warnings if item else ())]
    return lines
