"""The command ``sign``: say who made a store."""

# ruff: noqa: PLC0415

from __future__ import annotations

from pathlib import Path

import click

from grasp_factory.cli.params import STORE, Command, option
from grasp_factory.cli.printing import say
from grasp_factory.core.text_format import count


@click.command(
    cls=Command,
    examples=(
        "grasp-factory sign grasps.zarr --key ~/.ssh/id_ed25519",
        "grasp-factory verify grasps.zarr --signed-by id_ed25519.pub",
    ),
)
@STORE
@option(
    "--key",
    metavar="FILE",
    type=click.Path(path_type=Path),
    required=True,
    help="Private SSH key; a public key if an SSH agent holds the private one.",
)
def sign(path: Path, key: Path) -> None:
    """Sign a store with an SSH key.

    Writes the SHA-256 of every file of the store at PATH, and a signature of that list, to the
    folder `signature` of the store. Others check it with `verify --signed-by` and your public key.
    Needs ssh-keygen.
    """
    from grasp_factory.cli.bars import counted
    from grasp_factory.curation.signing import sign as run

    with counted("on_file", "file") as hooks:
        files = run(path, key, **hooks)
    say(f"{path}: {count(files, 'file')} signed")
