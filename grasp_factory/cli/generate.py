"""The command that makes a dataset: ``generate``."""

# ruff: noqa: PLC0415

from __future__ import annotations

import sys
from collections.abc import Collection
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn

import click

from grasp_factory.cli.options import (
    check_live,
    dataset_options,
    live_options,
    run_options,
)
from grasp_factory.cli.params import Command, json_option, option
from grasp_factory.cli.printing import print_json, say
from grasp_factory.cli.request import request_from
from grasp_factory.core.object_storage.address import is_remote
from grasp_factory.core.serialization import to_plain
from grasp_factory.core.text_format import count
from grasp_factory.errors import (
    EXIT_INTERRUPTED,
    EXIT_TERMINATED,
    FailuresError,
    Terminated,
    UsageError,
)
from grasp_factory.factory.run_request import Request

if TYPE_CHECKING:
    from grasp_factory.factory.run_records import Summary

_output = partial(option, heading="Output")


@click.command(
    cls=Command,
    examples=(
        "grasp-factory generate --n 1000 --workers 4 --out grasps.zarr",
        "grasp-factory generate --robot panda --policy top_down --out panda.zarr",
        "grasp-factory generate --n 100000 --dry-run",
        "grasp-factory generate --print-config > my.yaml",
        "grasp-factory generate --config my.yaml --seed 1 --out seed1.zarr",
    ),
)
@run_options
@dataset_options
@live_options
@_output("--print-config", is_flag=True, help="Print the config as YAML and stop.")
@_output(
    "--dry-run",
    is_flag=True,
    help="Run a few pilot episodes, print time, disk and memory of the whole run, and stop.",
)
@_output("--quiet", is_flag=True, help="Print errors only.")
@json_option("Output")
def generate(
    *,
    print_config: bool,
    dry_run: bool,
    live: bool,
    live_port: int | None,
    quiet: bool,
    as_json: bool,
    **options: Any,
) -> None:
    """Simulate grasp episodes and write them to a store.

    The episodes depend on the settings alone, not on the number of workers. Episodes that are in
    the store already stay as they are. To continue a stopped run, run the same command again.
    """
    check_live(live=live, live_port=live_port, makes_episodes=not (print_config or dry_run))
    request = request_from(continues=True, quiet=quiet, **options)
    if print_config:
        from grasp_factory.factory.name_check import check_names

        check_names(request.config)
        say(request.to_yaml(), end="")
        return
    if dry_run:
        if is_remote(request.out):
            raise UsageError(
                f"--dry-run: {request.out} is in object storage, valid: a path on a disk; the"
                " episodes take as long there"
            )
        from grasp_factory.cli.run_progress import forecast
        from grasp_factory.cli.run_report import forecast_text

        found = forecast(request)
        if as_json:
            print_json(to_plain(found) | {"fits": found.fits})
        else:
            say(forecast_text(found))
        return
    progress = None
    try:
        from grasp_factory.cli.run_progress import RunProgress, live_view, make

        progress = RunProgress(quiet=quiet)

        def run(part: Request) -> Summary:
            return make(part, progress, live_view(live_port, quiet=quiet) if live else None)

        if is_remote(request.out):
            from grasp_factory.curation.upload import generate_there
            from grasp_factory.factory.platform_check import check_same_platform

            tell = partial(_sending, request.out, quiet)
            summary = generate_there(request, run, check_same_platform, tell)
        else:
            summary = run(request)
    except KeyboardInterrupt as why:
        _stopped(request, progress.made if progress else (), why)
    if as_json:
        print_json(summary)
    elif not quiet:
        from grasp_factory.cli.run_report import summary_text

        say(summary_text(summary))
    if summary.failed:
        raise FailuresError(
            f"{len(summary.quarantined)} of {summary.asked} episodes are quarantined, more than"
            f" --max-failures {request.max_failures:g} allows; `grasp-factory info` counts them"
        )


def _sending(out: Path, quiet: bool, episodes: int) -> None:
    if not quiet:
        say(f"sending {count(episodes, 'episode')} to {out}", err=True)


def _stopped(request: Request, made: Collection[int], why: KeyboardInterrupt) -> NoReturn:
    from grasp_factory.cli.run_progress import stopped_text

    if is_remote(request.out):
        rest = "what is made is in the cache of this machine; run the same command again"
        say(f"Stopped: {rest} to continue.", err=True)
    else:
        say(stopped_text(request.out, made), err=True)
    sys.exit(EXIT_TERMINATED if isinstance(why, Terminated) else EXIT_INTERRUPTED)
