"""The command that describes a store for its publication: ``card``."""

# ruff: noqa: PLC0415

from __future__ import annotations

from pathlib import Path

import click

from grasp_factory.cli.params import AS_JSON, STORE, Command, option
from grasp_factory.cli.printing import print_json, say


@click.command(
    cls=Command,
    examples=(
        "grasp-factory card grasps.zarr",
        "grasp-factory card grasps.zarr --name Kuka --license cc-by-4.0 --out card",
    ),
)
@STORE
@option(
    "--out",
    metavar="DIR",
    type=click.Path(path_type=Path),
    help="Folder of the card.  [default: PATH.card, beside the store]",
)
@option("--name", metavar="TEXT", help="Name of the dataset.  [default: the store's name]")
@option(
    "--description",
    metavar="TEXT",
    help="Description of the dataset, in Markdown.  [default: one sentence]",
)
@option(
    "--license",
    "licence",
    metavar="ID",
    help="Licence identifier of the Hugging Face Hub, such as cc-by-4.0.  [default: the store's, or"
    " unknown with your own objects]",
)
@option("--url", metavar="URL", help="Web page of the dataset.")
@option(
    "--date-published",
    metavar="YYYY-MM-DD",
    help="Date of publication.  [default: no date]",
)
@option(
    "--version", metavar="TEXT", default="1.0.0", show_default=True, help="Version of the dataset."
)
@option("--force", is_flag=True, help="Replace files that were written or changed by hand.")
@AS_JSON
def card(path: Path, *, out: Path | None, force: bool, as_json: bool, **said: str) -> None:
    """Write a dataset card for a store.

    Writes a folder for the store at PATH with a README.md for the Hugging Face Hub, croissant.json,
    the columns of the episodes as episodes.csv, the config and figures. Does not change the store.
    docs/guides/card.md explains how to publish both.
    """
    from grasp_factory.apps.card import Publication, write_card

    result = write_card(path, out, Publication(**said), force=force)
    if as_json:
        print_json(result)
        return
    say("\n".join(str(Path(result.path, name)) for name in result.files))
    if result.missing:
        say(
            f"{result.missing} episodes of {path} are missing: run `grasp-factory generate`, then"
            " write the card again"
        )
    if result.licence == "unknown":
        say("the licence is unknown: set it with --license")
