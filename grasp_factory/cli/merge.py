"""The commands that put stores together and take them apart."""

# ruff: noqa: PLC0415

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, TextIO

import click

from grasp_factory.arguments import AS_JSON, IDS, STORE, indices, print_json
from grasp_factory.errors import UsageError, lookup, shown
from grasp_factory.platforms import ACCEPT
from grasp_factory.records import is_integer
from grasp_factory.yamltext import parse_yaml

if TYPE_CHECKING:
    from grasp_factory.collecting import Collected
    from grasp_factory.dataset import Dataset

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
    from grasp_factory.collecting import merge as run
    from grasp_factory.progress import counted

    with counted("on_row") as hooks:
        result = run(stores, out, accept_other_platform=accept_other_platform, **hooks)
    _print(result, as_json)


@click.command()
@STORE
@OUT
@click.option("--episodes", metavar="I,J,...", help="These rows.")
@IDS
@click.option(
    "--where",
    metavar="COLUMN=VALUE",
    multiple=True,
    help="Episodes with this value, or one of a list, as in policy=[top_down,uniform]. Repeatable.",
)
@AS_JSON
def split(
    path: Path,
    out: Path,
    *,
    episodes: str | None,
    ids: TextIO | None,
    where: tuple[str, ...],
    as_json: bool,
) -> None:
    """Put chosen episodes of a store into a new one.

    Chosen are those of the store at PATH that every option names, in ascending order. OUT must not
    exist; every episode is read back and compared before it does.
    """
    from grasp_factory.collecting import split as run
    from grasp_factory.dataset import Dataset
    from grasp_factory.progress import counted
    from grasp_factory.selection import read_selection, with_episode
    from grasp_factory.writers.zarr import COMMITTED

    given = [] if episodes is None else [indices(episodes)]
    dataset = Dataset.open(path)
    if ids is not None:
        given.append(with_episode(read_selection(ids, path), dataset.status == COMMITTED, path))
    given += [_matching(dataset, condition) for condition in where]
    if not given:
        raise UsageError("nothing is chosen: name episodes with --episodes, --ids or --where")
    common = set(given[0]).intersection(*given[1:])
    chosen = [index for index in given[0] if index in common]
    with counted("on_row") as hooks:
        result = run(path, out, chosen, **hooks)
    _print(result, as_json)


def _matching(dataset: Dataset, condition: str) -> list[int]:
    """Return the episodes that COLUMN=VALUE names."""
    column, equals, text = condition.partition("=")
    if not equals:
        what = f"--where {shown(condition)}"
        raise UsageError(f"{what}: expected COLUMN=VALUE, such as split=train")
    lookup(dict.fromkeys(dataset.columns), "column", column)
    value = parse_yaml(text, f"--where {column}")
    items = value if isinstance(value, list) else [value]
    if not all(isinstance(item, str | bool | float) or is_integer(item) for item in items):
        raise UsageError(f"--where {column}: got {shown(value)}, valid: a value, or [a, list]")
    found: list[int] = dataset.where(**{column: value}).tolist()
    return found


def _print(result: Collected, as_json: bool) -> None:
    from grasp_factory.report import collected_text

    if as_json:
        print_json(result)
    else:
        click.echo(collected_text(result))
