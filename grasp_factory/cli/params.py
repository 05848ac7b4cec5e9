"""What may stand on the command line: command names, and texts that stand for values."""

from __future__ import annotations

import json
import os
import re
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import click

from grasp_factory.core.serialization import to_plain
from grasp_factory.errors import ConfigError, UsageError, lookup, shown
from grasp_factory.factory.run_request import parse_size

STORE = click.argument("path", type=click.Path(path_type=Path))
IDS = click.option(
    "--ids", metavar="FILE", type=click.File(), help="Rows, one to a line; - is stdin."
)
AS_JSON = click.option("--json", "as_json", is_flag=True, help="Print JSON for scripts.")


class Commands(click.Group):
    """A group whose help lists the commands under headings.

    It answers an unknown command with the nearest and all valid ones.
    """

    def __init__(self, *args: Any, **kwargs: Any) -> None:
        super().__init__(*args, **kwargs)
        self._sections: dict[str, list[str]] = {}

    def add_section(self, heading: str, commands: Iterable[click.Command]) -> None:
        """Add commands, which the help lists under a heading."""
        for command in commands:
            self.add_command(command)
            assert command.name is not None
            self._sections.setdefault(heading, []).append(command.name)

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write the commands and their first sentences, section by section."""
        width = formatter.width - 6 - max(map(len, self.commands))
        for heading, names in self._sections.items():
            with formatter.section(heading):
                rows = [(name, self.commands[name].get_short_help_str(width)) for name in names]
                formatter.write_dl(rows)

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        """Return the command that the first argument names.

        Raises:
            UnknownNameError: naming the nearest and all valid commands.
        """
        lookup(self.commands, "command", args[0])
        return super().resolve_command(ctx, args)


def resolution(text: str) -> list[int]:
    """Return width and height from WxH."""
    try:
        return parse_size(text)
    except ConfigError as error:
        raise click.BadParameter(str(error)) from None


def weighted(text: str) -> tuple[str, float]:
    """Return name and weight from NAME[:WEIGHT]; the name may be a folder's."""
    name, colon, weight = text.rpartition(":")
    if not colon or os.path.isdir(text):  # unlike Path, it takes names that are too long
        return text, 1.0
    try:
        return name, float(weight)
    except ValueError:
        what = f"{shown(text)}: expected NAME or NAME:WEIGHT, as in x:2"
        raise click.BadParameter(what) from None


def indices(text: str) -> list[int]:
    """Return episode indices from I,J,...

    Raises:
        UsageError: if the text is something else.
    """
    if not re.fullmatch(r"[0-9]{1,9}(,[0-9]{1,9})*", text):
        raise UsageError(f"--episodes {shown(text)}: expected indices with commas, such as 0,3,7")
    return [int(word) for word in text.split(",")]


def print_json(record: Any) -> None:
    """Print a record for scripts."""
    click.echo(json.dumps(to_plain(record), indent=2))
