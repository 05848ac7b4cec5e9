"""The command that simulates a stored episode again: ``replay``."""

# ruff: noqa: PLC0415

from __future__ import annotations

import re
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from grasp_factory.cli.params import AS_JSON, STORE, Command, option, options, resolution
from grasp_factory.cli.plugin_options import allow_plugins, plugin_options
from grasp_factory.cli.printing import print_json, say
from grasp_factory.core.optional import require
from grasp_factory.core.serialization import to_plain
from grasp_factory.errors import EXIT_DONE, EXIT_FAILURE, UsageError, shown

if TYPE_CHECKING:
    from grasp_factory.apps.playback.playback import VideoPlan
    from grasp_factory.apps.playback.video_process import WrittenVideo

_video = partial(option, heading="Video")

_NUMBER = r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d{1,3})?"


def _point(
    ctx: click.Context, parameter: click.Parameter, text: str | None
) -> tuple[float, float, float] | None:
    """Return x, y, z in metres from X,Y,Z."""
    if text is None:
        return None
    if not re.fullmatch(rf"{_NUMBER}(,{_NUMBER}){{2}}", text) or len(text) > 200:
        raise click.BadParameter(f"got {shown(text)}, valid: X,Y,Z in metres, such as 0.9,-0.7,0.4")
    x, y, z = (float(word) for word in text.split(","))
    return x, y, z


def _size(
    ctx: click.Context, parameter: click.Parameter, text: str | None
) -> tuple[int, int] | None:
    """Return width and height in pixels from WxH."""
    if text is None:
        return None
    width, height = resolution(text)
    return width, height


@click.command(
    cls=Command,
    examples=(
        "grasp-factory replay grasps.zarr 17",
        "grasp-factory replay grasps.zarr 17 --video 17.mp4 --camera overhead",
        "grasp-factory replay grasps.zarr 17 --video 17.gif --speed 0.25",
    ),
)
@STORE
@click.argument("index", type=int)
@_video(
    "--video",
    metavar="FILE",
    type=click.Path(path_type=Path),
    help="Also write a video of the stored episode, an .mp4 or .gif file.",
)
@_video(
    "--camera",
    metavar="NAME",
    help="Camera of the store, or see `grasp-factory cameras`.  [default: the store's first]",
)
@_video(
    "--eye",
    metavar="X,Y,Z",
    callback=_point,
    help="Position of a free camera, in metres; needs --target.",
)
@_video(
    "--target",
    metavar="X,Y,Z",
    callback=_point,
    help="Point that the free camera looks at, in metres.",
)
@_video(
    "--resolution",
    metavar="WxH",
    callback=_size,
    help="Width and height, in pixels.  [default: the store's]",
)
@_video("--fps", metavar="FPS", type=float, help="Frames per second.  [default: 25]")
@_video(
    "--speed",
    metavar="FACTOR",
    type=float,
    help="Playback speed; 0.25 is four times slower.  [default: 1]",
)
@_video(
    "--caption/--no-caption",
    default=None,
    help="Show outcome and time below the images.  [default: caption]",
)
@option(
    "--session",
    metavar="FOLDER",
    type=click.Path(path_type=Path),
    help="Session of a real episode: it is imported again instead of simulated.",
)
@options(*plugin_options())
@AS_JSON
@click.pass_context
def replay(
    ctx: click.Context,
    /,
    path: Path,
    index: int,
    video: Path | None,
    *,
    session: Path | None,
    plugins: tuple[Path, ...],
    trust: bool,
    as_json: bool,
    **how: Any,
) -> None:
    """Make a stored episode again and compare the bytes.

    Simulates the episode with index INDEX of the store at PATH from its stored recipe. Exits with 0
    if the result has the same bytes, and with 1 otherwise. --video shows the stored episode.
    """
    given = {name: value for name, value in how.items() if value is not None}
    if video is None and given:
        raise UsageError(f"--{next(iter(given))} is for a video: add --video FILE.mp4")
    from grasp_factory.cli.replay_report import replay_text
    from grasp_factory.curation.replay import replay as run
    from grasp_factory.curation.replay import replay_import

    allow_plugins(path, plugins, trust=trust)
    plan = None if video is None else _plan(path, index, video, given)
    if session is None:
        result = run(path, index)
    else:
        require("mcap", "rosbags", extra="capture")
        result = replay_import(path, index, session)
    made = None if plan is None else _write(plan)
    if as_json:
        facts = to_plain(result) | {"platform": result.platform}
        print_json(facts | ({} if made is None else {"video": to_plain(made)}))
    else:
        say(replay_text(result))
        if made is not None:
            say(made.path)
    ctx.exit(EXIT_DONE if result.same else EXIT_FAILURE)


def _plan(path: Path, index: int, video: Path, given: dict[str, Any]) -> VideoPlan:
    """Return the plan of a video.

    Raises:
        UsageError: for options that are not valid together or for this store.
        StoreError: if the episode cannot be read.
    """
    from grasp_factory.apps.playback.playback import Pace, View, free_camera, plan_video
    from grasp_factory.dataset.dataset import Dataset
    from grasp_factory.dataset.selection import check_index

    pace = Pace(**{name: given.pop(name) for name in ("fps", "speed") if name in given})
    ends = [given.pop(name) for name in ("eye", "target") if name in given]
    if len(ends) == 1:
        raise UsageError("--eye and --target belong together: set both")
    view = View(pace=pace, place=free_camera(*ends) if ends else None, **given)
    dataset = Dataset(path)
    return plan_video(dataset, check_index(dataset, index), video, view)


def _write(plan: VideoPlan) -> WrittenVideo:
    """Write a video and show a progress bar."""
    from grasp_factory.apps.playback.video_process import write_video
    from grasp_factory.cli.bars import watched

    with watched("frame", len(plan.times)) as count:
        return write_video(plan, count)
