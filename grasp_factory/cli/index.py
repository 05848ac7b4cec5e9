"""The command that builds an index of stores: ``index``."""

# ruff: noqa: PLC0415

from __future__ import annotations

from pathlib import Path

import click

from grasp_factory.cli.params import AS_JSON, STORE_PATH, Command, option
from grasp_factory.cli.printing import print_json, say
from grasp_factory.core.serialization import to_plain


@click.command(
    cls=Command,
    examples=(
        "grasp-factory index grasps.zarr",
        "grasp-factory index grasps.zarr seed1.zarr --out all.sqlite",
    ),
)
@click.argument("paths", metavar="PATH...", nargs=-1, required=True, type=STORE_PATH)
@option(
    "--out",
    metavar="FILE",
    type=click.Path(path_type=Path),
    help="Index file.  [default: in the cache]",
)
@AS_JSON
def index(paths: tuple[Path, ...], out: Path | None, as_json: bool) -> None:
    """Build an index of stores.

    Writes an SQLite file with a row for each episode of the stores at PATH, for `query` and
    `browse`. It holds only what is in the stores, so it can be deleted and built again at any time.
    """
    from grasp_factory.cli.bars import counted
    from grasp_factory.core.text_format import count, size_text
    from grasp_factory.dataset.index import build, default_path

    with counted("on_row") as hooks:
        built = build(paths, out or default_path(paths), **hooks)
    if as_json:
        stores = [str(store) for store in built.stores]
        print_json({**to_plain(built), "path": str(built.path), "stores": stores})
        return
    say(
        f"{built.path}: {count(built.rows, 'row')} of {count(len(built.stores), 'store')} in"
        f" {built.seconds:.1f} s, {size_text(built.bytes)}"
    )
