"""The commands that copy stores to others: ``merge``, ``split`` and ``pack``."""

# ruff: noqa: PLC0415

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from grasp_factory.cli.params import AS_JSON, STORE, STORE_PATH, Command, option
from grasp_factory.cli.printing import print_json, say
from grasp_factory.cli.row_choice import chosen_rows, row_options
from grasp_factory.core.object_storage.address import is_remote
from grasp_factory.core.platforms import ACCEPT
from grasp_factory.errors import UsageError

if TYPE_CHECKING:
    from grasp_factory.curation.merge import Collected

OUT = click.argument("out", type=STORE_PATH)


@click.command(
    cls=Command,
    examples=(
        "grasp-factory merge all.zarr grasps.zarr seed1.zarr",
        "grasp-factory merge all.zarr grasps.zarr seed1.zarr --json",
    ),
)
@OUT
@click.argument("stores", metavar="STORE...", nargs=-1, type=STORE_PATH)
@option(
    ACCEPT,
    is_flag=True,
    help="Also merge parts of one seed that were made on different platforms.",
)
@AS_JSON
def merge(
    out: Path, stores: tuple[Path, ...], *, accept_other_platform: bool, as_json: bool
) -> None:
    """Merge several stores into one.

    Parts of one seed become the dataset of that seed again. Stores of different seeds are
    concatenated. Only the seed may differ between their configs. OUT must not exist; it appears
    when every episode has been read back and compared.
    """
    from grasp_factory.cli.bars import counted
    from grasp_factory.curation.merge import merge as run

    with counted("on_row") as hooks:
        result = run(stores, out, accept_other_platform=accept_other_platform, **hooks)
    _print(result, as_json)


@click.command(
    cls=Command,
    examples=(
        "grasp-factory split grasps.zarr train.zarr --where split=train",
        "grasp-factory split grasps.zarr few.zarr --episodes 0,3,7",
        "grasp-factory query grasps.zarr --where tags=odd --ids > odd.txt",
        "grasp-factory split grasps.zarr odd.zarr --ids odd.txt",
    ),
)
@STORE
@OUT
@row_options
@AS_JSON
def split(path: Path, out: Path, *, as_json: bool, **options: Any) -> None:
    """Copy chosen episodes to a new store.

    Copies the episodes of the store at PATH that all options choose, in ascending order. OUT must
    not exist; it appears when every episode has been read back and compared.
    """
    from grasp_factory.cli.bars import counted
    from grasp_factory.curation.merge import split as run
    from grasp_factory.dataset.dataset import Dataset

    chosen = chosen_rows(Dataset(path), **options)
    if chosen is None:
        raise UsageError("no episodes are chosen: name them with --episodes, --ids or --where")
    with counted("on_row") as hooks:
        result = run(path, out, chosen, **hooks)
    _print(result, as_json)


@click.command(
    cls=Command,
    examples=(
        "grasp-factory pack grasps.zarr packed.zarr --shard 512",
        "grasp-factory verify packed.zarr",
    ),
)
@STORE
@OUT
@option(
    "--shard",
    metavar="N",
    type=int,
    default=512,
    show_default=True,
    help="Episodes of a file: a multiple of the store's block size, up to 1024.",
)
@AS_JSON
def pack(path: Path, out: Path, *, shard: int, as_json: bool) -> None:
    """Copy a store to one with larger and fewer files.

    The new store has the bytes of a store that was made with `--set block_size=N`. OUT must not
    exist; it appears when it is complete. A run that ends early goes on with the same command.
    """
    from grasp_factory.cli.bars import counted
    from grasp_factory.core.text_format import count
    from grasp_factory.curation.pack import pack_store
    from grasp_factory.curation.upload import pack_there

    make = pack_there if is_remote(out) else pack_store
    with counted("on_row") as hooks:
        result = make(path, out, shard, **hooks)
    if as_json:
        print_json(result)
        return
    text = f"{result.path}: {count(result.rows, 'row')} in {count(result.blocks, 'block')}"
    if result.resumed:
        text += f"; {result.resumed} of them were finished before"
    say(text)


def _print(result: Collected, as_json: bool) -> None:
    if as_json:
        print_json(result)
    else:
        say(_text(result))


def _text(result: Collected) -> str:
    from grasp_factory.cli.store_report import sources_lines
    from grasp_factory.core.text_format import count, joined_lines

    head = f"{result.path}: {count(result.committed, 'episode')}, all read back and compared"
    if result.repeated:
        head += f"; {count(result.repeated, 'row')} of several stores were written once"
    lines = [head, *sources_lines(result.sources)]
    if result.quarantined:
        lines.append(f"{result.quarantined} of {result.rows} episodes are quarantined")
    if result.missing:
        lines.append(
            f"{result.missing} of {result.rows} episodes are missing:"
            " run `grasp-factory generate` on this store"
        )
    lines += [f"labels/{name} was copied" for name in result.labels]
    lines += [f"labels/{n} was not copied: {why}" for n, why in result.labels_left_out.items()]
    if result.annotations:
        lines.append(f"annotations of {count(result.annotations, 'episode')} were copied")
    return joined_lines([*lines, *(f"warning: {warning}" for warning in result.warnings)])
