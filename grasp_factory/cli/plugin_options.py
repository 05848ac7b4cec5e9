"""The options that let a command run code of the user, or of a store: ``--plugin``, ``--trust``."""

# ruff: noqa: PLC0415

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from grasp_factory.cli.params import OPTIONS, option
from grasp_factory.cli.printing import say
from grasp_factory.core.plugins.plugin_sources import allow_file

if TYPE_CHECKING:
    from grasp_factory.core.config.factory_config import FactoryConfig


def plugin_options(heading: str = OPTIONS) -> tuple[Callable[[Any], Any], ...]:
    """Return the decorators of ``--plugin`` and ``--trust``: arguments ``plugins``, ``trust``."""
    return (
        option(
            "--plugin",
            "plugins",
            metavar="FILE",
            type=click.Path(path_type=Path),
            multiple=True,
            heading=heading,
            help="Python file that the store was made with; it must be the same file. Repeatable.",
        ),
        option(
            "--trust",
            is_flag=True,
            heading=heading,
            help="Run the copies of such files in the store. Read them first, with"
            " `grasp-factory info --full`.",
        ),
    )


def allow_plugins(store: Path, files: Sequence[Path], *, trust: bool) -> None:
    """Let this process run files of the user, and those of a store if it is trusted.

    Raises:
        PluginError: if a file cannot be read.
        StoreError: if the store is damaged.
    """
    for file in files:
        allow_file(file)
    if trust:
        from grasp_factory.dataset.dataset import Dataset

        trust_store(store, Dataset(store).config)


def trust_store(store: Path, config: FactoryConfig) -> None:
    """Let this process run the source files of a store, and say on stderr which ones."""
    from grasp_factory.factory.plugins import trust

    for source in trust(store, config):
        say(f"running {source.name} of {store} (SHA-256 {source.sha256})", err=True)
