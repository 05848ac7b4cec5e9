"""What commands print. Texts may come from a stranger's store: a terminal must not obey them."""

from __future__ import annotations

import json
import sys
from collections.abc import Iterable
from typing import Any

import click

from grasp_factory.core.serialization import to_plain
from grasp_factory.core.text_format import escaped, escaped_lines


def say(text: object = "", *, err: bool = False, end: str = "\n") -> None:
    """Print a text of one or more lines, its unprintable characters as escape codes.

    Args:
        text: the text.
        err: print to stderr.
        end: what follows the text.
    """
    click.echo(escaped_lines(str(text)) + end, err=err, nl=False)


def say_lines(lines: Iterable[str]) -> None:
    """Print many lines to stdout, each in one line whatever is in it."""
    sys.stdout.writelines(f"{escaped(line)}\n" for line in lines)


def show_status(text: str) -> None:
    """Show a short text in the last line of stderr, a terminal; it replaces the one before."""
    click.echo(f"\r\033[K{escaped(text)}", err=True, nl=False)


def print_json(record: Any) -> None:
    """Print a record as JSON, in ASCII."""
    click.echo(json.dumps(to_plain(record), indent=2))
