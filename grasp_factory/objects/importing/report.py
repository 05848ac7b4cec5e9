"""The report of an import, as ``grasp-factory objects DIR`` prints it."""

from __future__ import annotations

from collections.abc import Sequence

from grasp_factory.objects.importing.base import FolderReport, ImportedObject

HEADER = ("object", "size, mm", "mass, g", "parts", "split")

MAX_NAME = 60
"""Characters of an id in the table."""


def report_text(report: FolderReport) -> str:
    """Return a table of what can be used, with warnings, and a list of what cannot."""
    lines = [
        f"{len(report.usable)} usable, {len(report.refused)} refused",
        *(f"warning: {printable(warning)}" for warning in report.warnings),
    ]
    if report.usable:
        lines += ["", *_table([HEADER, *(_row(item) for item in report.usable)], report.usable)]
    if report.refused:
        lines += ["", "Refused:"]
        for refusal in report.refused:
            lines.append(f"  {printable(refusal.file)}: {printable(refusal.reason)}")
    return "\n".join(lines)


def printable(text: str) -> str:
    """Return a text in which whatever a terminal could take for a command is escaped."""
    return "".join(
        c if c.isprintable() else c.encode("unicode_escape", "surrogatepass").decode("ascii")
        for c in text
    )


def _row(item: ImportedObject) -> tuple[str, ...]:
    size = " x ".join(f"{side * 1e3:.0f}" for side in item.sides)
    name = printable(item.object_id)
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
        lines += [f"      {printable(warning)}" for warning in (item.warnings if item else ())]
    return lines
