"""Large JSON files whose items are written part by part: only text is joined at the end."""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

from grasp_factory.writers.exporters.base import ExportJob, ExportPart
from grasp_factory.writers.exporters.json_file import finite

_BETWEEN = ",\n"


def item(data: Any) -> str:
    """Return plain data as JSON in one line; NaN and infinite numbers are null."""
    return json.dumps(finite(data), allow_nan=False)


def member(key: str, data: Any) -> str:
    """Return a member of a JSON object."""
    return f"{json.dumps(key)}: {item(data)}"


def keep_items(job: ExportJob, part: ExportPart, name: str, items: Iterable[str]) -> None:
    """Keep a part's items or members of a file aside, until ``joined_items`` joins all of them.

    Raises:
        OSError: if they cannot be written.
    """
    path = job.aside / name
    path.mkdir(exist_ok=True)
    text = _BETWEEN.join(items)
    if text:
        (path / f"{part.number:08d}").write_text(text, encoding="utf-8")


def joined_items(job: ExportJob, name: str) -> Iterator[str]:
    """Yield the text of all items that the parts kept, in the order of the parts."""
    path = job.aside / name
    files = sorted(path.iterdir()) if path.is_dir() else []
    for k, file in enumerate(files):
        yield _BETWEEN if k else ""
        yield file.read_text(encoding="utf-8")


def write_items(path: Path, opening: str, items: Iterable[str], closing: str) -> None:
    """Write a JSON file: an opening such as ``[``, items, and a closing.

    Raises:
        OSError: if it cannot be written.
    """
    with path.open("w", encoding="utf-8") as file:
        file.write(f"{opening}\n")
        file.writelines(items)
        file.write(f"\n{closing}\n")
