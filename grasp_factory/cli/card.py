"""The command that describes a store for those who did not make it."""

# ruff: noqa: PLC0415

from __future__ import annotations

from pathlib import Path

import click

from grasp_factory.cli.params import AS_JSON, STORE, print_json


@click.command()
@STORE
@click.option(
    "--out",
    type=click.Path(path_type=Path),
    help="Folder for the card.  [default: PATH.card, beside the store]",
)
@click.option("--name", help="Of the dataset.  [default: the store's]")
@click.option("--description", help="What it is, in Markdown.  [default: one sentence]")
@click.option(
    "--license",
    "licence",
    metavar="ID",
    help="As the Hub calls it, such as cc-by-4.0.  [default: the store's own; unknown with objects"
    " of your own]",
)
@click.option("--url", help="The dataset's page.")
@click.option("--date-published", metavar="YYYY-MM-DD", help="The card has no date without it.")
@click.option("--version", default="1.0.0", show_default=True, help="Of the dataset.")
@click.option("--force", is_flag=True, help="Replace files that somebody wrote or changed.")
@AS_JSON
def card(path: Path, *, out: Path | None, force: bool, as_json: bool, **said: str) -> None:
    """Write a dataset card for the store at PATH.

    A README.md as the Hugging Face Hub wants it, croissant.json for machines, the episodes as
    episodes.csv, the config, and figures. The store is only read; docs/card.md says how to publish
    both.
    """
    from grasp_factory.apps.card import Publication, write_card

    result = write_card(path, out, Publication(**said), force=force)
    if as_json:
        print_json(result)
        return
    click.echo("\n".join(str(Path(result.path, name)) for name in result.files))
    if result.missing:
        click.echo(
            f"{result.missing} rows of {path} are missing: write it again when they are there"
        )
    if result.licence == "unknown":
        click.echo("the licence is unknown: --license names one")
