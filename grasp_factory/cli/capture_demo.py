"""The command that records simulated devices: ``capture demo``."""

# ruff: noqa: PLC0415

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import TYPE_CHECKING

import click

from grasp_factory.cli.params import Command, json_option, option
from grasp_factory.cli.printing import say
from grasp_factory.core.optional import require

if TYPE_CHECKING:
    from grasp_factory.core.episode import Episode

NOISE = "stereo"


@click.command(
    cls=Command,
    name="demo",
    examples=(
        "grasp-factory capture demo --out demo_session",
        "grasp-factory capture demo grasps.zarr --row 3 --out demo_session --live",
    ),
)
@click.argument("store", metavar="[STORE]", required=False, type=click.Path(path_type=Path))
@option(
    "--row",
    metavar="N",
    type=click.IntRange(0),
    default=0,
    show_default=True,
    help="Episode of the store to play.",
)
@option(
    "--out",
    metavar="FOLDER",
    type=click.Path(path_type=Path),
    help="Folder to create.  [default: session_DATE_TIME, here]",
)
@option("--live", is_flag=True, help="Serve a page with images, curves, rates and alarms.")
@json_option()
def capture_demo(
    store: Path | None, row: int, out: Path | None, *, live: bool, as_json: bool
) -> None:
    """Record simulated devices: no hardware is needed.

    The devices play an episode of STORE, with the noise of sensors, over real serial lines and
    network ports of this machine; drivers read them as they read real devices. Without STORE, an
    episode is simulated first.
    """
    require("mcap", "rosbags", extra="capture")
    from grasp_factory.capture.session.demo import demo_models, demo_stage
    from grasp_factory.cli.capture_recording import LiveOptions, default_folder, record
    from grasp_factory.signals.noise import noisy

    models = demo_models()
    episode = noisy(_stored(store, row) if store else _simulated(), NOISE)
    with demo_stage(episode, models) as stage:
        record(
            stage.config,
            models,
            out or default_folder(stage.config),
            {},
            live=LiveOptions(is_wanted=live, port=None),
            quiet=False,
            as_json=as_json,
            stage=stage,
        )


def _stored(store: Path, row: int) -> Episode:
    from grasp_factory.dataset.dataset import Dataset

    return Dataset(store, checked=True)[row]


def _simulated() -> Episode:
    from grasp_factory.core.config.factory_config import FactoryConfig
    from grasp_factory.dataset.dataset import Dataset
    from grasp_factory.factory.generate import generate

    say("Simulating an episode to play", err=True)
    with tempfile.TemporaryDirectory(prefix="grasp_factory_demo_") as folder:
        path = Path(folder) / "demo.zarr"
        generate(FactoryConfig(video_hz=30), 1, path, 1)
        return Dataset(path)[0]
