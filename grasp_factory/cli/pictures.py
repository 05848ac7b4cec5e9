"""The commands that draw pictures."""

# ruff: noqa: PLC0415

from __future__ import annotations

from pathlib import Path
from typing import Any, TextIO

import click

from grasp_factory.cli.options import dataset_options, request_from
from grasp_factory.cli.params import IDS, STORE, indices, resolution
from grasp_factory.errors import UsageError


@click.command()
@STORE
@click.argument("out", type=click.Path(path_type=Path))
@click.option("--episodes", metavar="I,J,...", help="These rows.  [default: some, of both classes]")
@IDS
@click.option("--n", type=int, help="How many at most.  [default: 12; tiles: 60]")
@click.option("--tiles", is_flag=True, help="Many small ones: before and after, up to 600.")
@click.option("--columns", type=int, help="Tiles side by side.  [default: a sheet of 4:3, about]")
@click.option("--camera", help="Which one.  [default: the first]")
def sheet(
    path: Path,
    out: Path,
    *,
    episodes: str | None,
    ids: TextIO | None,
    n: int | None,
    tiles: bool,
    columns: int | None,
    camera: str | None,
) -> None:
    """Draw a contact sheet of a store.

    The PNG image OUT gets a row for each episode of the store at PATH: before, after, depth and
    segmentation, labelled with the outcome. With --tiles, it gets a grid of many.
    """
    from grasp_factory.apps.pictures.sheet import check_png, sheet_of, write_png
    from grasp_factory.apps.pictures.tiles import tiles_of
    from grasp_factory.dataset.dataset import Dataset

    if episodes is not None and ids is not None:
        raise UsageError("--episodes and --ids: valid: one of them")
    if columns is not None and not tiles:
        raise UsageError("--columns is for --tiles")
    check_png(out)
    dataset = Dataset.open(path)
    wanted = None if episodes is None else indices(episodes)
    if ids is not None:
        from grasp_factory.dataset.selection import read_selection, with_episode
        from grasp_factory.writers.zarr.writer import COMMITTED

        wanted = read_selection(ids, path)
        if not tiles:
            wanted = with_episode(wanted, dataset.status == COMMITTED, path)
    shown = camera or next(iter(dataset.config.cameras))
    if tiles:
        image = tiles_of(dataset, wanted, shown, n, columns)
    else:
        image = sheet_of(dataset, wanted, shown, n)
    write_png(out, image)
    click.echo(out)


@click.command()
@STORE
@click.argument("episode", type=int)
@click.argument("out", required=False, type=click.Path(path_type=Path))
@click.option("--camera", help="Which one.  [default: the first]")
@click.option(
    "--size", metavar="WxH", default="1600x1200", show_default=True, help="Of the picture, pixels."
)
def plot(path: Path, episode: int, out: Path | None, camera: str | None, size: str) -> None:
    """Draw the curves and images of an episode.

    The PNG image OUT shows row EPISODE of the store at PATH: joints, gripper, pad forces, wrist and
    IMU on one time axis with the phases, images before and after, and touch on the pads. OUT is
    episode_EPISODE.png in the current folder unless given.
    """
    from grasp_factory.apps.pictures.plot import plot_episode
    from grasp_factory.apps.pictures.sheet import check_png, write_png
    from grasp_factory.dataset.dataset import Dataset

    out = Path(f"episode_{episode}.png") if out is None else out
    check_png(out)
    width, height = resolution(size)
    image = plot_episode(Dataset.open(path), episode, camera, (width, height))
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
    from grasp_factory.apps.pictures.preview import draw_preview
    from grasp_factory.apps.pictures.sheet import check_png, write_png
    from grasp_factory.cli.progress import Counter

    check_png(out)
    config = request_from(**options).config
    with Counter(n, "scene") as counter:
        image = draw_preview(config, n, counter.count)
    write_png(out, image)
    click.echo(out)
