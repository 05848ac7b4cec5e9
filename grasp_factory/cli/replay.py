"""The commands that bring back a stored attempt."""

# ruff: noqa: PLC0415

from __future__ import annotations

import re
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from grasp_factory.cli.params import AS_JSON, STORE, print_json, resolution
from grasp_factory.core.serialization import to_plain
from grasp_factory.errors import EXIT_DONE, EXIT_FAILURE, UsageError, shown

if TYPE_CHECKING:
    from grasp_factory.apps.playback.playback import VideoPlan, WrittenVideo

_NUMBER = r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d{1,3})?"


def _point(
    ctx: click.Context, option: click.Parameter, text: str | None
) -> tuple[float, float, float] | None:
    """Return x, y, z from X,Y,Z."""
    if text is None:
        return None
    if not re.fullmatch(rf"{_NUMBER}(,{_NUMBER}){{2}}", text) or len(text) > 200:
        raise click.BadParameter(f"{shown(text)}: expected metres X,Y,Z, such as 0.9,-0.7,0.4")
    x, y, z = (float(word) for word in text.split(","))
    return x, y, z


def _size(ctx: click.Context, option: click.Parameter, text: str | None) -> tuple[int, int] | None:
    """Return width and height from WxH."""
    if text is None:
        return None
    width, height = resolution(text)
    return width, height


@click.command()
@STORE
@click.argument("index", type=int)
@click.option(
    "--video", type=click.Path(path_type=Path), help="Write the attempt to FILE.mp4 or FILE.gif."
)
@click.option("--camera", help="That sees it: one of the store's or of `cameras`.  [default: 1st]")
@click.option("--eye", metavar="X,Y,Z", callback=_point, help="Or: where to look from, metres.")
@click.option("--target", metavar="X,Y,Z", callback=_point, help="And where to, metres.")
@click.option("--resolution", metavar="WxH", callback=_size, help="Pixels.  [default: the store's]")
@click.option("--fps", type=float, help="Frames per second.  [default: 25]")
@click.option("--speed", type=float, help="0.25 shows it four times slower.  [default: 1]")
@click.option("--caption/--no-caption", default=None, help="Outcome and time below.  [default: on]")
@AS_JSON
@click.pass_context
def replay(
    ctx: click.Context, /, path: Path, index: int, video: Path | None, as_json: bool, **how: Any
) -> None:
    """Make a stored episode again and compare; show it.

    Runs the recipe of episode INDEX of the store at PATH. Exits with 0 if the result is the same,
    byte for byte, and with 1 if it is not. The video shows what is stored.
    """
    given = {name: value for name, value in how.items() if value is not None}
    if video is None and given:
        raise UsageError(f"--{next(iter(given))} is about a video: add --video FILE.mp4")
    from grasp_factory.cli.curation_report import replay_text
    from grasp_factory.curation.replay import replay as run

    plan = None if video is None else _plan(path, index, video, given)
    result = run(path, index)
    made = None if plan is None else _write(plan)
    if as_json:
        told = to_plain(result) | {"platform": result.platform}
        print_json(told | ({} if made is None else {"video": to_plain(made)}))
    else:
        click.echo(replay_text(result))
        if made is not None:
            click.echo(made.path)
    ctx.exit(EXIT_DONE if result.same else EXIT_FAILURE)


def _plan(path: Path, index: int, video: Path, given: dict[str, Any]) -> VideoPlan:
    """Return what there is to do for a video.

    Raises:
        UsageError: for what cannot be.
        StoreError: if the episode cannot be read.
    """
    from grasp_factory.apps.playback.playback import Pace, View, free_camera, plan_video
    from grasp_factory.curation.replay import check_index
    from grasp_factory.dataset.dataset import Dataset

    pace = Pace(**{name: given.pop(name) for name in ("fps", "speed") if name in given})
    ends = [given.pop(name) for name in ("eye", "target") if name in given]
    if len(ends) == 1:
        raise UsageError("--eye and --target belong together: give both")
    view = View(pace=pace, place=free_camera(*ends) if ends else None, **given)
    dataset = Dataset.open(path)
    return plan_video(dataset, check_index(dataset, index), video, view)


def _write(plan: VideoPlan) -> WrittenVideo:
    """Write a video, with a bar."""
    from grasp_factory.apps.playback.playback import write_video
    from grasp_factory.cli.progress import watched

    with watched("frame", len(plan.times)) as count:
        return write_video(plan, count)


@click.command("rerun")
@STORE
@click.argument("index", type=int)
@click.option(
    "--out", type=click.Path(path_type=Path), help="Its name.  [default: STORE-INDEX.rrd, here]"
)
@click.option("--open", "opened", is_flag=True, help="Show it in the Rerun viewer, until it ends.")
def rerun_(path: Path, index: int, out: Path | None, opened: bool) -> None:
    """Write a stored episode as a Rerun recording.

    It has images, point cloud, robot, objects and measurements of episode INDEX of the store at
    PATH on one clock. Needs the extra rerun. Nothing leaves this machine.
    """
    from grasp_factory.apps.rerun import default_file, open_viewer, require_rerun
    from grasp_factory.dataset.dataset import Dataset

    require_rerun()
    from grasp_factory.apps.rerun.recording import write_recording
    from grasp_factory.curation.replay import check_index

    dataset = Dataset.open(path)
    index = check_index(dataset, index)
    out = out or default_file(path, index)
    write_recording(dataset, index, out)
    click.echo(out)
    if opened:
        open_viewer(out)
