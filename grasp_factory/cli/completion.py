"""Names that a shell completes: rows of tables, of this package and of installed ones."""

# ruff: noqa: PLC0415

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any

import click
from click.shell_completion import CompletionItem

Complete = Callable[[click.Context, click.Parameter, str], list[Any]]


def completes(names: Callable[[], Iterable[str]], *, files: bool = False) -> Complete:
    """Return what completes an option's value: names, or else files if there may be some.

    Args:
        names: returns the names; it is called when the shell asks.
        files: whether the value may be a file or a folder, too.
    """

    def complete(ctx: click.Context, parameter: click.Parameter, begun: str) -> list[Any]:
        found = [CompletionItem(name) for name in sorted(names()) if name.startswith(begun)]
        return found or ([CompletionItem(begun, type="file")] if files else [])

    return complete


def rows_of(kind: str) -> Callable[[], Iterable[str]]:
    """Return what lists the names of a kind of plugins; see ``plugin_origin.KINDS``."""

    def names() -> Iterable[str]:
        from grasp_factory.core.plugins.entry_points import installed
        from grasp_factory.factory.plugin_rows import TABLES

        return {*TABLES[kind], *installed(kind)}

    return names


def formats() -> Iterable[str]:
    """Return the formats of exports."""
    from grasp_factory.core.plugins.entry_points import installed
    from grasp_factory.writers.exporters import EXPORTERS

    return {*EXPORTERS, *installed("exporters")}


def column_names() -> Iterable[str]:
    """Return the columns of the index."""
    from grasp_factory.dataset.index import COLUMNS

    return [column.name for column in COLUMNS]
