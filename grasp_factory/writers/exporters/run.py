"""One export: checked first, built in a scratch folder, then moved to its path as a whole."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from grasp_factory.core.output_file import is_in_store
from grasp_factory.core.scratch_folder import scratch_folder
from grasp_factory.errors import StoreError, UsageError
from grasp_factory.writers.exporters.base import EpisodeSource, ExportContents, Exporter, ExportJob


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
        rows: rows that hold an episode, in the order in which they are exported.
        out: the file or folder to create.
        settings: the format's settings as plain data.
        on_episode: called after each episode.

    Raises:
        UsageError: for a path that cannot be written to, a missing library, or episodes that the
            format cannot hold.
        ConfigError: for a setting that is not valid.
        StoreError: if the dataset is damaged, or the disk fails or is full.
    """
    exporter.check_libraries()
    chosen = exporter.settings(settings)
    _check_place(out, exporter.suffix)
    try:
        with scratch_folder(out.parent, f"{out.name}.exporting") as scratch:
            built = scratch / out.name
            contents = exporter.write(
                ExportJob(
                    source=source,
                    rows=tuple(rows),
                    out=built,
                    settings=chosen,
                    on_episode=on_episode,
                )
            )
            size = _bytes_of(built)
            _publish(built, out)
    except OSError as error:
        raise StoreError(f"{out} cannot be written: {error.strerror or error}") from None
    return Exported(
        path=out, format=exporter.name, episodes=len(rows), bytes=size, contents=contents
    )


def _check_place(out: Path, suffix: str) -> None:
    if suffix and out.suffix != suffix:
        raise UsageError(f"{out}: got a name that ends in {out.suffix!r}, valid: {suffix!r}")
    if not out.parent.is_dir():
        raise UsageError(f"{out}: the folder {out.parent} does not exist")
    if is_in_store(out):
        raise UsageError(f"{out} is inside a store, which holds data only: choose another folder")
    if os.path.lexists(out):
        raise UsageError(f"{out} exists, and an export overwrites nothing: choose another name")


def _publish(built: Path, out: Path) -> None:
    """Move what was built to its path, unless something has appeared there."""
    if built.is_dir():
        out.mkdir()  # fails if it exists; the move replaces this empty folder
        os.replace(built, out)
    else:
        os.link(built, out)  # a move would replace a file that has appeared there


def _bytes_of(path: Path) -> int:
    files = [path] if path.is_file() else [file for file in path.rglob("*") if file.is_file()]
    return sum(file.stat().st_size for file in files)
