"""The commands that draw pictures."""

# ruff: noqa: PLC0415

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from grasp_factory.arguments import STORE, indices
from grasp_factory.options import dataset_options, request_from


@click.command()
@STORE
@click.argument("out", type=click.Path(path_type=Path))
@click.option(
    "--episodes", metavar="I,J,...", help="Which ones.  [default: up to 12, both classes]"
)
@click.option("--camera", help="Which one.  [default: the first]")
def sheet(path: Path, out: Path, episodes: str | None, camera: str | None) -> None:
    """Draw a contact sheet of a store.

    The PNG image OUT gets a row for each episode of the store at PATH: before, after, depth and
    segmentation, labelled with the outcome.
    """
    from grasp_factory.dataset import Dataset
    from grasp_factory.sheet import sheet_of, write_png

    dataset = Dataset.open(path)
    wanted = None if episodes is None else indices(episodes)
    image = sheet_of(dataset, wanted, camera or next(iter(dataset.config.cameras)))
    write_png(out, image)
    click.echo(out)


@click.command()
@click.argument("out", type=click.Path(path_type=Path))
@click.option("--n", type=int, default=24, show_default=True, help="Scenes.")
@dataset_options
def preview(out: Path, n: int, **options: Any) -> None:
    """Draw scenes as they would be, without grasping.

    The PNG image OUT gets the first scenes of a dataset with these settings, as the first camera
    sees them before the attempt.
    """
    from grasp_factory.preview import draw_preview
    from grasp_factory.progress import Counter
    from grasp_factory.sheet import check_png, write_png

    check_png(out)
    config = request_from(**options).config
    with Counter(n, "scene") as counter:
        image = draw_preview(config, n, counter.count)
    write_png(out, image)
    click.echo(out)
