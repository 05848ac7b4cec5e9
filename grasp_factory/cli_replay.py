"""The commands that bring back a stored attempt."""

# ruff: noqa: PLC0415

from __future__ import annotations

from pathlib import Path

import click

from grasp_factory.arguments import AS_JSON, STORE, print_json
from grasp_factory.errors import EXIT_DONE, EXIT_FAILURE


@click.command()
@STORE
@click.argument("index", type=int)
@AS_JSON
@click.pass_context
def replay(ctx: click.Context, path: Path, index: int, as_json: bool) -> None:
    """Make a stored episode again and compare.

    Runs the recipe of episode INDEX of the store at PATH. Exits with 0 if the result is the same,
    byte for byte, and with 1 if it is not.
    """
    from grasp_factory.replay import replay as run
    from grasp_factory.report import replay_text

    result = run(path, index)
    if as_json:
        print_json(result)
    else:
        click.echo(replay_text(result))
    ctx.exit(EXIT_DONE if result.same else EXIT_FAILURE)
