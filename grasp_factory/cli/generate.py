"""The command that makes a dataset."""

# ruff: noqa: PLC0415

from __future__ import annotations

import sys
from typing import Any, NoReturn

import click

from grasp_factory.cli.options import (
    check_live,
    dataset_options,
    live_options,
    request_from,
    run_options,
)
from grasp_factory.cli.params import AS_JSON, print_json
from grasp_factory.core.serialization import to_plain
from grasp_factory.errors import EXIT_INTERRUPTED, EXIT_TERMINATED, FailuresError, Terminated
from grasp_factory.factory.run_request import Request


@click.command()
@run_options
@dataset_options
@click.option("--print-config", is_flag=True, help="Print the settings as YAML and make nothing.")
@click.option("--dry-run", is_flag=True, help="Make some, keep none; say what the run would take.")
@live_options
@click.option("--quiet", is_flag=True, help="Print errors only.")
@AS_JSON
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
    """Make grasp episodes, or complete a store.

    The same settings give the same episodes, whatever the number of workers; what is there
    already stays as it is. So a run may be stopped, and started again with the same command.
    """
    check_live(live=live, live_port=live_port, makes_something=not (print_config or dry_run))
    request = request_from(**options)
    if print_config:
        from grasp_factory.factory.name_check import check_names

        check_names(request.config)
        click.echo(request.to_yaml(), nl=False)
        return
    if dry_run:
        from grasp_factory.cli.run_progress import forecast
        from grasp_factory.cli.run_report import forecast_text

        found = forecast(request)
        if as_json:
            print_json(to_plain(found) | {"fits": found.fits})
        else:
            click.echo(forecast_text(found))
        return
    try:
        from grasp_factory.cli.run_progress import live_view, make

        view = live_view(live_port, quiet=quiet) if live else None
        summary = make(request, quiet=quiet, view=view)
    except KeyboardInterrupt as why:
        _stopped(request, why)
    if as_json:
        print_json(summary)
    elif not quiet:
        from grasp_factory.cli.run_report import summary_text

        click.echo(summary_text(summary))
    if summary.failed:
        raise FailuresError(
            f"{len(summary.quarantined)} of {summary.asked} episodes are quarantined, more than"
            f" --max-failures {request.max_failures:g} allows; `grasp-factory info` counts them"
        )


def _stopped(request: Request, why: KeyboardInterrupt) -> NoReturn:
    from grasp_factory.cli.run_progress import stopped_text

    click.echo(stopped_text(request.out), err=True)
    sys.exit(EXIT_TERMINATED if isinstance(why, Terminated) else EXIT_INTERRUPTED)
