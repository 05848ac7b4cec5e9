"""The commands that put stores together and take them apart."""

# ruff: noqa: PLC0415

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from grasp_factory.cli.params import AS_JSON, STORE, print_json
from grasp_factory.cli.row_choice import chosen_rows, row_options
from grasp_factory.core.platforms import ACCEPT
from grasp_factory.errors import UsageError

if TYPE_CHECKING:
    from grasp_factory.curation.merge import Collected

OUT = click.argument("out", type=click.Path(path_type=Path))


@click.command()
@OUT
@click.argument("stores", metavar="STORE...", nargs=-1, type=click.Path(path_type=Path))
@click.option(
    ACCEPT, is_flag=True, help="Merge also parts of a seed that were made on different platforms."
)
@AS_JSON
def merge(
    out: Path, stores: tuple[Path, ...], *, accept_other_platform: bool, as_json: bool
) -> None:
    """Put several stores into one.

    Parts of one seed's dataset become that dataset again; stores of different seeds follow one
    another. Their settings may differ in the seed alone. OUT must not exist; every episode is read
    back and compared before it does.
    """
    from grasp_factory.cli.progress import counted
    from grasp_factory.curation.merge import merge as run

    with counted("on_row") as hooks:
        result = run(stores, out, accept_other_platform=accept_other_platform, **hooks)
    _print(result, as_json)


@click.command()
@STORE
@OUT
@row_options
@AS_JSON
def split(path: Path, out: Path, *, as_json: bool, **options: Any) -> None:
    """Put chosen episodes of a store into a new one.

    Chosen are those of the store at PATH that every option names, in ascending order. OUT must not
    exist; every episode is read back and compared before it does.
    """
    from grasp_factory.cli.progress import counted
    from grasp_factory.curation.merge import split as run
    from grasp_factory.dataset.dataset import Dataset

    chosen = chosen_rows(Dataset.open(path), **options)
    if chosen is None:
        raise UsageError("nothing is chosen: name episodes with --episodes, --ids or --where")
    with counted("on_row") as hooks:
        result = run(path, out, chosen, **hooks)
    _print(result, as_json)


def _print(result: Collected, as_json: bool) -> None:
    from grasp_factory.cli.curation_report import collected_text

    if as_json:
        print_json(result)
    else:
        click.echo(collected_text(result))
