"""Parts of the command line: commands and options with grouped help, and parsers of values."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Any, TypeVar

import click

from grasp_factory.core.object_storage.address import store_path
from grasp_factory.core.plugins.file_loading import file_reference
from grasp_factory.errors import ConfigError, lookup, shown
from grasp_factory.factory.run_request import parse_size

F = TypeVar("F", bound=Callable[..., Any])

OPTIONS = "Options"
"""Heading of the options that name no other."""


class Option(click.Option):
    """An option with the heading that it stands under in the help."""

    def __init__(self, *args: Any, heading: str = OPTIONS, **kwargs: Any) -> None:
        super().__init__(*args, **kwargs)
        self.heading = heading


class Command(click.Command):
    """A command whose help groups the options under headings and ends with examples.

    Args:
        examples: Command lines. The help prints each as it is, without wrapping it.
    """

    def __init__(self, *args: Any, examples: Sequence[str] = (), **kwargs: Any) -> None:
        super().__init__(*args, **kwargs)
        self.examples = tuple(examples)

    def format_options(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write the options, heading by heading, in the order of their first options."""
        sections: dict[str, list[tuple[str, str]]] = {}
        for parameter in self.get_params(ctx):
            record = parameter.get_help_record(ctx)
            if record is not None and isinstance(parameter, click.Option):
                heading = parameter.heading if isinstance(parameter, Option) else OPTIONS
                sections.setdefault(heading, []).append(record)
        for heading, records in sections.items():
            with formatter.section(heading):
                formatter.write_dl(records)

    def format_epilog(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write the examples."""
        if self.examples:
            with formatter.section("Examples"):
                for line in self.examples:
                    formatter.write(f"{' ' * formatter.current_indent}{line}\n")


class Commands(click.Group):
    """A group whose help lists the commands under headings.

    For an unknown command, the error names the nearest and all valid ones.
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
        """Write the commands and their first sentences, heading by heading."""
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
            UnknownNameError: naming the nearest and all valid commands; not while a shell completes
                the words after it.
        """
        if not ctx.resilient_parsing:
            lookup(self.commands, "command", args[0])
        return super().resolve_command(ctx, args)


def option(*names: str, heading: str = OPTIONS, **settings: Any) -> Callable[[F], F]:
    """Return a decorator that adds an option; see ``click.option`` for the settings."""
    return click.option(*names, cls=Option, heading=heading, **settings)


def options(*decorators: Callable[[F], F]) -> Callable[[F], F]:
    """Return a decorator that adds several options in this order."""

    def add(command: F) -> F:
        for decorator in reversed(decorators):
            command = decorator(command)
        return command

    return add


def json_option(heading: str = OPTIONS) -> Callable[[F], F]:
    """Return the decorator of ``--json``, which fills the argument ``as_json``."""
    return option("--json", "as_json", is_flag=True, heading=heading, help="Print JSON.")


class StorePath(click.Path):
    """A path on this machine, or the address of a store in object storage."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """See ``store_path``."""
        return store_path(value)


STORE_PATH = StorePath(path_type=Path)
STORE = click.argument("path", type=STORE_PATH)
AS_JSON = json_option()


def resolution(text: str) -> list[int]:
    """Return width and height, in pixels, from WxH."""
    try:
        return parse_size(text)
    except ConfigError as error:
        raise click.BadParameter(str(error)) from None


def weighted(text: str) -> tuple[str, float]:
    """Return name and weight from NAME[:WEIGHT]; the name may be a folder, or FILE.py:NAME."""
    name, colon, weight = text.rpartition(":")
    # Unlike Path.is_dir, os.path.isdir accepts names that are too long.
    if not colon or file_reference(text) or os.path.isdir(text):
        return text, 1.0
    try:
        return name, float(weight)
    except ValueError:
        what = f"got {shown(text)}, valid: NAME or NAME:WEIGHT, such as top_down:2"
        raise click.BadParameter(what) from None
