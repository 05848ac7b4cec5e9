"""The ``grasp-factory`` command: parse, call one function, print.

What is slow to import is imported by the command that needs it, so that ``--help`` is quick.
"""

# ruff: noqa: PLC0415

from __future__ import annotations

import sys
from collections.abc import Mapping
from importlib import import_module
from pathlib import Path
from typing import Any, NoReturn

import click

from grasp_factory import __version__
from grasp_factory.arguments import AS_JSON, STORE, Commands, print_json
from grasp_factory.cli_browse import browse
from grasp_factory.cli_card import card
from grasp_factory.cli_flywheel import flywheel
from grasp_factory.cli_index import index, query
from grasp_factory.cli_look import plot, preview, sheet
from grasp_factory.cli_merge import merge, split
from grasp_factory.cli_replay import replay, rerun_
from grasp_factory.cli_store import repair, verify
from grasp_factory.cli_tag import tag, tags
from grasp_factory.cli_train import learning_curve, train
from grasp_factory.config import FactoryConfig
from grasp_factory.errors import (
    EXIT_DONE,
    EXIT_FAILURE,
    EXIT_INTERRUPTED,
    EXIT_TERMINATED,
    FailuresError,
    Terminated,
)
from grasp_factory.options import (
    check_live,
    dataset_options,
    live_options,
    request_from,
    run_options,
)
from grasp_factory.records import to_plain
from grasp_factory.request import Request

DEFAULTS = Request(config=FactoryConfig())


@click.group(
    cls=Commands,
    invoke_without_command=True,
    subcommand_metavar="COMMAND [ARGS]...",
    context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100},
)
@click.version_option(__version__, prog_name="grasp-factory")
@click.pass_context
def cli(ctx: click.Context) -> None:
    """Make datasets of robot grasps in simulation, and look at them."""
    if ctx.invoked_subcommand is None:
        click.echo(ctx.get_help())


@cli.command()
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
        from grasp_factory.factory import check_names

        check_names(request.config)
        click.echo(request.to_yaml(), nl=False)
        return
    if dry_run:
        from grasp_factory.progress import forecast
        from grasp_factory.report import forecast_text

        found = forecast(request)
        if as_json:
            print_json(to_plain(found) | {"fits": found.fits})
        else:
            click.echo(forecast_text(found))
        return
    try:
        from grasp_factory.progress import live_view, make

        view = live_view(live_port, quiet=quiet) if live else None
        summary = make(request, quiet=quiet, view=view)
    except KeyboardInterrupt as why:
        _stopped(request, why)
    if as_json:
        print_json(summary)
    elif not quiet:
        from grasp_factory.report import summary_text

        click.echo(summary_text(summary))
    if summary.failed:
        raise FailuresError(
            f"{len(summary.quarantined)} of {summary.asked} episodes are quarantined, more than"
            f" --max-failures {request.max_failures:g} allows; `grasp-factory info` counts them"
        )


@cli.command()
@STORE
@AS_JSON
def info(path: Path, as_json: bool) -> None:
    """Say what the store at PATH holds."""
    from grasp_factory import report
    from grasp_factory.dataset import Dataset
    from grasp_factory.summary import array_facts, summarise

    dataset = Dataset.open(path)
    store, arrays = summarise(dataset), array_facts(dataset)
    if as_json:
        more = {"attributes": dict(dataset.attributes), "arrays": arrays}
        print_json(to_plain(store) | more)
        return
    click.echo(report.store_text(store, report.GROUPS))
    click.echo("\n" + report.arrays_text(arrays))
    click.echo("\n" + report.origin_text(dataset.attributes))


@cli.command()
@STORE
@click.option("--name", required=True, help="Of the new label column, labels/NAME.")
@click.option("--min-lift", type=float, help="Metres above the rest, at the end of the hold.")
@click.option("--min-shake", type=float, help="Level of the shake to survive; 0 for none.")
@click.option("--min-grip-force", type=float, help="Newtons of either pad, during the hold.")
@click.option("--max-slip-distance", type=float, help="Metres in the hand.")
@click.option("--max-slip-angle", type=float, help="Radians in the hand.")
@AS_JSON
def relabel(path: Path, name: str, as_json: bool, **thresholds: float | None) -> None:
    """Label a store anew, from other thresholds, without simulating.

    Thresholds that are not given are those the store at PATH was made with. Its own labels stay.
    """
    from grasp_factory.dataset import Dataset
    from grasp_factory.records import from_plain
    from grasp_factory.relabel import relabel as run
    from grasp_factory.report import relabel_text
    from grasp_factory.sections import LabelConfig

    given = {key: value for key, value in thresholds.items() if value is not None}
    settings = to_plain(Dataset.open(path).config.label) | given
    result = run(path, name, from_plain(LabelConfig, settings))
    if as_json:
        print_json(result)
    else:
        click.echo(relabel_text(result))


@cli.command("check-physics")
@click.option("--short", is_flag=True, help="A minute instead of ten: fewer episodes.")
@AS_JSON
def check_physics(short: bool, as_json: bool) -> None:
    """Measure on this machine how far forces and labels can be trusted.

    Prints each figure beside its bound; exits with 1 if one is not met.
    """
    from grasp_factory.checks import FULL, SHORT
    from grasp_factory.checks import check_physics as run
    from grasp_factory.report import figures_text

    figures = list(run(SHORT if short else FULL, lambda part: click.echo(f"{part} ...", err=True)))
    if as_json:
        print_json([to_plain(f) | {"passes": f.passes, "bound": f.bound} for f in figures])
    else:
        click.echo(figures_text(figures))
    sys.exit(EXIT_DONE if all(f.passes for f in figures) else EXIT_FAILURE)


@cli.command()
@click.argument("folder", required=False, type=click.Path(path_type=Path))
@click.option("--robot", default=DEFAULTS.config.robot, help="Whose gripper must hold them.")
@AS_JSON
@click.pass_context
def objects(ctx: click.Context, folder: Path | None, robot: str, as_json: bool) -> None:
    """List the sets of objects, or check a FOLDER of your own.

    Every URDF, OBJ, STL and PLY file of the folder can be used or is refused with a reason;
    exits with 1 if none can be used. `grasp-factory generate --objects FOLDER` drops them.
    """
    from grasp_factory.objects import OBJECT_SETS

    if folder is None:
        _print_listing({name: found.description for name, found in OBJECT_SETS.items()}, as_json)
        return
    from grasp_factory.folders import import_for
    from grasp_factory.meshes import report_text

    report = import_for(folder, robot)
    if as_json:
        print_json(report)
    else:
        click.echo(report_text(report))
    ctx.exit(EXIT_DONE if report.usable else EXIT_FAILURE)


def _add_listing(name: str, help: str) -> None:
    """Add a command that lists a table: ``robots``, ``policies`` or ``cameras``."""

    @cli.command(name, help=help)
    @AS_JSON
    def listing(as_json: bool) -> None:
        entries = getattr(import_module(f"grasp_factory.{name}"), name.upper())
        _print_listing({key: entry.description for key, entry in entries.items()}, as_json)


_add_listing("robots", "List the robots.")
_add_listing("policies", "List the policies, which choose grasps from images.")
_add_listing("cameras", "List the cameras that have names.")

for _command in (
    *(browse, card, flywheel, index, learning_curve, merge, plot, preview, query, repair),
    *(replay, rerun_, sheet, split, tag, tags, train, verify),
):
    cli.add_command(_command)


def _print_listing(rows: Mapping[str, str], as_json: bool) -> None:
    from grasp_factory.report import table

    if as_json:
        print_json(rows)
    else:
        click.echo(table(rows.items()))


def _stopped(request: Request, why: KeyboardInterrupt) -> NoReturn:
    from grasp_factory.progress import stopped_text

    click.echo(stopped_text(request.out), err=True)
    sys.exit(EXIT_TERMINATED if isinstance(why, Terminated) else EXIT_INTERRUPTED)
