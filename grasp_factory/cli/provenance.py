"""The command ``provenance``: what a thing was made of."""

# ruff: noqa: PLC0415

from __future__ import annotations

from pathlib import Path

import click

from grasp_factory.cli.params import AS_JSON, STORE_PATH, Command
from grasp_factory.cli.printing import print_json, say_lines


@click.command(
    cls=Command,
    examples=(
        "grasp-factory provenance merged.zarr",
        "grasp-factory provenance baselines/vision.safetensors",
    ),
)
@click.argument("path", type=STORE_PATH)
@AS_JSON
def provenance(path: Path, *, as_json: bool) -> None:
    """Print what a thing was made of.

    PATH is a store, the folder of an export, or the folder or a model of `train`. Stores are named
    by a hash of their rows, and by the newest snapshot that has the same rows.
    """
    from grasp_factory.curation.versions.provenance_tree import provenance_of

    found = provenance_of(path)
    if as_json:
        print_json(found)
    else:
        say_lines(found.lines())
