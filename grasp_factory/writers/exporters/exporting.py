"""One export: checked first, built in a scratch folder, then moved to its path as a whole."""

from __future__ import annotations

import contextlib
import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from grasp_factory.core.output_file import is_in_store
from grasp_factory.core.place import place_at
from grasp_factory.core.place_tree import fsync_tree
from grasp_factory.core.scratch_folder import scratch_folder
from grasp_factory.errors import StoreError, UsageError
from grasp_factory.writers.exporters.base import EpisodeSource, ExportContents, Exporter, ExportJob
from grasp_factory.writers.zarr.writer import COMMITTED, QUARANTINED

_OCCUPIED = "exists, and an export overwrites nothing: choose another name"
_LONGEST_PREFIX = 40
"""Characters of the name that the hidden scratch folder repeats: file systems limit its length."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Exported:
    """What an export wrote."""

    path: Path
    format: str
    episodes: int
    bytes: int
    contents: ExportContents


def run_export(
    exporter: Exporter,
    source: EpisodeSource,
    rows: Sequence[int],
    out: Path,
    settings: Mapping[str, Any],
    *,
    on_episode: Callable[[], None] = lambda: None,
) -> Exported:
    """Export rows of a dataset to ``out``, which must not exist; after an error it still does not.

    Args:
        exporter: the format.
        source: the dataset.
        rows: rows that hold an episode, one or more, each once, in the order of the export.
        out: the file or folder to create.
        settings: the format's settings as plain data.
        on_episode: called after each episode.

    Raises:
        UsageError: for a place that is taken or cannot be written to, a missing library, rows
            without an episode, or episodes that the format cannot hold.
        ConfigError: for a setting that is not valid.
        StoreError: if the dataset is damaged, or the disk fails or is full.
    """
    exporter.check_libraries()
    chosen = exporter.settings(settings)
    _check_place(out, exporter.suffix)
    _check_rows(source, rows)
    try:
        with scratch_folder(out.parent, f"{out.name[:_LONGEST_PREFIX]}.exporting") as scratch:
            built = scratch / out.name
            job = ExportJob(
                source=source, rows=tuple(rows), out=built, settings=chosen, on_episode=on_episode
            )
            contents = exporter.write(job)
            size = _bytes_of(built)
            fsync_tree(place_at(built))
            _publish(built, out)
    except OSError as error:
        raise StoreError(f"{out} cannot be written: {error.strerror or error}") from None
    return Exported(
        path=out, format=exporter.name, episodes=len(rows), bytes=size, contents=contents
    )


def _check_place(out: Path, suffix: str) -> None:
    if suffix and out.suffix.lower() != suffix:
        raise UsageError(f"{out}: got a name that ends in {out.suffix!r}, valid: {suffix!r}")
    if not out.parent.is_dir():
        raise UsageError(f"{out}: the folder {out.parent} does not exist")
    if is_in_store(out):
        raise UsageError(f"{out} is inside a store, which holds data only: choose another folder")
    if os.path.lexists(out):
        raise UsageError(f"{out} {_OCCUPIED}")


def _check_rows(source: EpisodeSource, rows: Sequence[int]) -> None:
    """Check that the rows are one or more, each once, and that all of them hold an episode."""
    status = source.column("status")
    if len(rows) == 0:
        raise UsageError(f"{source.path}: there are no episodes to export; choose some that exist")
    seen = set[int]()
    for row in rows:
        if not 0 <= row < len(status):
            raise UsageError(f"{source.path}: got row {row}, valid: 0 to {len(status) - 1}")
        if status[row] != COMMITTED:
            why = "quarantined" if status[row] == QUARANTINED else "missing"
            raise UsageError(f"{source.path}: row {row} has no episode: it is {why}; leave it out")
        if row in seen:
            raise UsageError(f"{source.path}: row {row} is named twice; name each row once")
        seen.add(row)


def _publish(built: Path, out: Path) -> None:
    """Move the result to its place, unless something exists there by now.

    An empty file or folder reserves the name first, and the move replaces it. A hard link would
    be enough for files, but not all file systems have them.
    """
    is_folder = built.is_dir()
    try:
        if is_folder:
            out.mkdir()
        else:
            out.touch(exist_ok=False)
    except FileExistsError:
        raise UsageError(f"{out} {_OCCUPIED}") from None
    try:
        os.replace(built, out)
    except BaseException:
        with contextlib.suppress(OSError):
            (out.rmdir if is_folder else out.unlink)()
        raise


def _bytes_of(path: Path) -> int:
    files = [path] if path.is_file() else [file for file in path.rglob("*") if file.is_file()]
    return sum(file.stat().st_size for file in files)
