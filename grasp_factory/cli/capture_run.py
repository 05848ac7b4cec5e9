"""The command that records a session: ``capture run``."""

# ruff: noqa: PLC0415

from __future__ import annotations

from dataclasses import replace
from functools import partial
from pathlib import Path

import click

from grasp_factory.cli.params import Command, json_option, option
from grasp_factory.core.optional import require

_live = partial(option, heading="Live page")
_session = partial(option, heading="Session")


@click.command(
    cls=Command,
    name="run",
    examples=(
        "grasp-factory capture run session.yaml",
        "grasp-factory capture run session.yaml --duration 120 --out kitchen_1 --live",
    ),
)
@click.argument("file", metavar="SESSION.YAML", type=click.Path(path_type=Path))
@_session(
    "--out",
    metavar="FOLDER",
    type=click.Path(path_type=Path),
    help="Folder to create.  [default: the name in the settings, here]",
)
@_session(
    "--duration",
    metavar="S",
    type=click.FloatRange(0.1, 7 * 86400),
    help="Seconds to record.  [default: as in the settings]",
)
@_live("--live", is_flag=True, help="Serve a page with images, curves, rates and alarms.")
@_live(
    "--live-port",
    metavar="PORT",
    type=click.IntRange(1, 65535),
    help="Port of the page.  [default: 8642, or the next free port]",
)
@option("--quiet", is_flag=True, heading="Output", help="Print alarms and errors only.")
@json_option("Output")
def capture_run(
    file: Path,
    out: Path | None,
    *,
    duration: float | None,
    live: bool,
    live_port: int | None,
    quiet: bool,
    as_json: bool,
) -> None:
    """Record a session of all devices in a settings file.

    Writes the folder of the session: session.mcap, which any ROS tool reads, the settings, and at
    the end session.json with counts. Ends after the duration, with Ctrl-C, at an emergency stop,
    or when the disk is nearly full. If the recorder is killed, at most the last 0.5 s are lost:
    `capture recover` makes the file whole.
    """
    require("mcap", "rosbags", extra="capture")
    from grasp_factory.capture.session.session_config import device_models, read_session_config
    from grasp_factory.capture.session.session_folder import read_calibrations
    from grasp_factory.cli.capture_recording import LiveOptions, default_folder, record

    config = read_session_config(file)
    if duration is not None:
        config = replace(config, duration_s=duration)
    record(
        config,
        device_models(config),
        out or default_folder(config),
        read_calibrations(config, file.parent),
        live=LiveOptions(is_wanted=live, port=live_port),
        quiet=quiet,
        as_json=as_json,
    )
