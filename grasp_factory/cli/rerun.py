"""The command that exports an episode to Rerun: ``rerun``."""

# ruff: noqa: PLC0415

from __future__ import annotations

from pathlib import Path

import click

from grasp_factory.cli.params import STORE, Command, option
from grasp_factory.cli.printing import say


@click.command(
    "rerun",
    cls=Command,
    examples=(
        "grasp-factory rerun grasps.zarr 17",
        "grasp-factory rerun grasps.zarr 17 --out slip.rrd --open",
    ),
)
@STORE
@click.argument("index", type=int)
@option(
    "--out",
    metavar="FILE",
    type=click.Path(path_type=Path),
    help="Recording file.  [default: STORE-INDEX.rrd in the current folder]",
)
@option(
    "--open", "opened", is_flag=True, help="Open it in the Rerun viewer; wait until that closes."
)
def rerun_(path: Path, index: int, out: Path | None, opened: bool) -> None:
    """Export one episode as a Rerun recording.

    The recording has the images, point cloud, robot, objects and measurements of the episode with
    index INDEX of the store at PATH on one time axis. Needs the extra `rerun`. Sends no data to
    other machines.
    """
    from grasp_factory.apps.rerun import default_file, open_viewer, require_rerun
    from grasp_factory.dataset.dataset import Dataset

    require_rerun()
    from grasp_factory.apps.rerun.recording import write_recording
    from grasp_factory.dataset.selection import check_index

    dataset = Dataset(path)
    index = check_index(dataset, index)
    out = out or default_file(path, index)
    write_recording(dataset, index, out)
    say(out)
    if opened:
        open_viewer(out)
