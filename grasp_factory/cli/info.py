"""The command that summarizes a store: ``info``."""

# ruff: noqa: PLC0415

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import click

from grasp_factory.cli.params import AS_JSON, STORE_PATH, Command, option
from grasp_factory.cli.printing import print_json, say
from grasp_factory.core.serialization import to_plain
from grasp_factory.errors import UsageError


@click.command(
    cls=Command,
    examples=(
        "grasp-factory info grasps.zarr",
        "grasp-factory info grasps.zarr --full",
        "grasp-factory info monday.zarr tuesday.zarr",
        "grasp-factory info grasps.zarr --json",
    ),
)
@click.argument("paths", metavar="PATH...", nargs=-1, required=True, type=STORE_PATH)
@option("--full", is_flag=True, help="Also print all tables, the arrays, the versions, the config.")
@AS_JSON
def info(paths: tuple[Path, ...], full: bool, as_json: bool) -> None:
    """Show the contents and the success rates of a store.

    Counts the episodes of the store at PATH by outcome, policy, object and split. Several stores,
    whose configs differ in seed and block size alone, are counted as one, and then each for itself.
    """
    if len(paths) == 1:
        _tell_one(paths[0], full=full, as_json=as_json)
    elif full:
        raise UsageError("--full: valid for one store only")
    else:
        _tell_several(paths, as_json=as_json)


def _tell_several(paths: Sequence[Path], *, as_json: bool) -> None:
    from grasp_factory.cli.store_report import short_text, stores_table
    from grasp_factory.dataset.dataset import Dataset
    from grasp_factory.dataset.summary import summarise

    together = summarise(Dataset(paths))
    each = [summarise(Dataset(path)) for path in paths]
    if as_json:
        print_json(to_plain(together) | {"stores": to_plain(each)})
        return
    say(short_text(together))
    say("\n" + stores_table(each))


def _tell_one(path: Path, *, full: bool, as_json: bool) -> None:
    from grasp_factory.cli.plugin_report import plugins_text
    from grasp_factory.cli.store_report import (
        GROUPS,
        arrays_text,
        origin_text,
        short_text,
        store_text,
    )
    from grasp_factory.dataset.dataset import Dataset
    from grasp_factory.dataset.summary import array_facts, summarise

    dataset = Dataset(path)
    store, arrays = summarise(dataset), array_facts(dataset)
    if as_json:
        more = {"attributes": dict(dataset.attributes), "arrays": arrays}
        print_json(to_plain(store) | more)
        return
    if not full:
        say(short_text(store))
        return
    say(store_text(store, GROUPS))
    say("\n" + arrays_text(arrays))
    say("\n" + origin_text(dataset.attributes))
    if code := plugins_text(path, dataset.config):
        say("\n" + code)
