"""The commands that draw pictures: ``sheet``, ``plot`` and ``preview``."""

# ruff: noqa: PLC0415

from __future__ import annotations

from pathlib import Path
from typing import Any, TextIO

import click

from grasp_factory.cli.options import dataset_options
from grasp_factory.cli.params import STORE, Command, option, resolution
from grasp_factory.cli.printing import say
from grasp_factory.cli.request import request_from
from grasp_factory.cli.row_choice import list_options, listed_rows
from grasp_factory.errors import UsageError

CAMERA = option("--camera", metavar="NAME", help="Camera.  [default: the store's first]")


@click.command(
    cls=Command,
    examples=(
        "grasp-factory sheet grasps.zarr sheet.png",
        "grasp-factory sheet grasps.zarr chosen.png --episodes 0,3,7",
        "grasp-factory sheet grasps.zarr many.png --tiles --n 100",
    ),
)
@STORE
@click.argument("out", type=click.Path(path_type=Path))
@list_options
@option(
    "--n",
    metavar="N",
    type=int,
    help="Largest number of episodes.  [default: 12, or 60 with --tiles]",
)
@option("--tiles", is_flag=True, help="Draw up to 600 small images, before and after the attempt.")
@option(
    "--columns",
    metavar="N",
    type=int,
    help="Tiles in a row.  [default: chosen for a sheet of about 4:3]",
)
@CAMERA
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
    """Draw a contact sheet of episodes.

    Writes the PNG image OUT with a row for each episode of the store at PATH: images before and
    after the attempt, depth and segmentation, and the outcome. With --tiles, writes a grid of small
    images. Without --episodes or --ids, chooses both successes and failures.
    """
    from grasp_factory.apps.pictures.sheet import check_png, sheet_of, write_png
    from grasp_factory.apps.pictures.tiles import tiles_of
    from grasp_factory.dataset.dataset import Dataset
    from grasp_factory.writers.zarr.writer import COMMITTED

    if episodes is not None and ids is not None:
        raise UsageError("--episodes and --ids: valid: one of them")
    if columns is not None and not tiles:
        raise UsageError("--columns is the number of tiles in a row: add --tiles")
    check_png(out)
    dataset = Dataset(path)
    wanted = listed_rows(path, episodes, ids, None if tiles else dataset.status == COMMITTED)
    shown = camera or next(iter(dataset.config.cameras))
    if tiles:
        image = tiles_of(dataset, wanted, shown, n, columns)
    else:
        image = sheet_of(dataset, wanted, shown, n)
    write_png(out, image)
    say(out)


@click.command(
    cls=Command,
    examples=(
        "grasp-factory plot grasps.zarr 17",
        "grasp-factory plot grasps.zarr 17 large.png --size 2400x1800",
    ),
)
@STORE
@click.argument("episode", type=int)
@click.argument("out", required=False, type=click.Path(path_type=Path))
@CAMERA
@option(
    "--size",
    metavar="WxH",
    default="1600x1200",
    show_default=True,
    help="Width and height of the picture, in pixels.",
)
def plot(path: Path, episode: int, out: Path | None, camera: str | None, size: str) -> None:
    """Plot the signals and images of one episode.

    Writes the PNG image OUT for the episode with index EPISODE of the store at PATH: joints,
    gripper, pad forces, wrist and IMU on one time axis with the phases, images before and after the
    attempt, and touch on the pads. OUT is episode_EPISODE.png in the current folder by default.
    """
    from grasp_factory.apps.pictures.plot import plot_episode
    from grasp_factory.apps.pictures.sheet import check_png, write_png
    from grasp_factory.dataset.dataset import Dataset

    out = Path(f"episode_{episode}.png") if out is None else out
    check_png(out)
    width, height = resolution(size)
    image = plot_episode(Dataset(path), episode, camera, (width, height))
    write_png(out, image)
    say(out)


@click.command(
    cls=Command,
    examples=(
        "grasp-factory preview scenes.png",
        "grasp-factory preview scenes.png --n 12 --randomize strong --clutter 4",
        "grasp-factory preview scenes.png --objects classic --camera wrist",
    ),
)
@click.argument("out", type=click.Path(path_type=Path))
@option(
    "--n",
    metavar="N",
    type=int,
    default=24,
    show_default=True,
    heading="Run",
    help="Number of scenes.",
)
@dataset_options
def preview(out: Path, n: int, **options: Any) -> None:
    """Draw the first scenes of a dataset without grasping.

    Writes the PNG image OUT with the first scenes of a dataset with these settings, as the first
    camera sees them before the attempt.
    """
    from grasp_factory.apps.pictures.preview import draw_preview
    from grasp_factory.apps.pictures.sheet import check_png, write_png
    from grasp_factory.core.progress import Progress

    check_png(out)
    config = request_from(**options).config
    with Progress(n, "scene") as progress:
        image = draw_preview(config, n, progress.count)
    write_png(out, image)
    say(out)
