"""The ``grasp-factory`` command and the table of its subcommands.

To add a subcommand, write its file and add it to ``COMMANDS``. Slow imports stand inside of the
command that needs them, so that ``--help`` is fast and works without PyBullet.
"""

from __future__ import annotations

import os
from collections.abc import Mapping

import click

from grasp_factory import __version__
from grasp_factory.cli.active_learning import flywheel
from grasp_factory.cli.browse import browse
from grasp_factory.cli.calibrate import calibrate
from grasp_factory.cli.capture import capture
from grasp_factory.cli.card import card
from grasp_factory.cli.check_physics import check_physics
from grasp_factory.cli.conformance import conformance
from grasp_factory.cli.export import export
from grasp_factory.cli.generate import generate
from grasp_factory.cli.import_data import import_
from grasp_factory.cli.index import index
from grasp_factory.cli.info import info
from grasp_factory.cli.listings import cameras, objects, policies, robots, sensors
from grasp_factory.cli.merge import merge, pack, split
from grasp_factory.cli.params import Commands
from grasp_factory.cli.pictures import plot, preview, sheet
from grasp_factory.cli.provenance import provenance
from grasp_factory.cli.query import query
from grasp_factory.cli.relabel import relabel
from grasp_factory.cli.repair import repair
from grasp_factory.cli.replay import replay
from grasp_factory.cli.rerun import rerun_
from grasp_factory.cli.sign import sign
from grasp_factory.cli.snapshot import diff, log, snapshot
from grasp_factory.cli.tag import tag, tags
from grasp_factory.cli.train import learning_curve, train
from grasp_factory.cli.verify import verify
from grasp_factory.core import limits

COMMANDS: Mapping[str, tuple[click.Command, ...]] = {
    "Make a dataset": (
        generate,
        preview,
        objects,
        robots,
        policies,
        cameras,
        sensors,
        conformance,
        check_physics,
    ),
    "View a dataset": (info, sheet, plot, browse, replay, rerun_, card),
    "Search and annotate episodes": (index, query, tag, tags),
    "Check, change and export a dataset": (
        verify,
        repair,
        sign,
        relabel,
        merge,
        split,
        pack,
        export,
    ),
    "Keep versions of a dataset": (snapshot, log, diff, provenance),
    "Use recordings of real robots": (capture, calibrate, import_),
    "Train on a dataset": (train, learning_curve, flywheel),
}
"""Heading in the help to subcommands."""


@click.group(
    cls=Commands,
    invoke_without_command=True,
    subcommand_metavar="COMMAND [ARGS]...",
    context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100},
)
@click.version_option(__version__, prog_name="grasp-factory")
@click.option(
    "--limit",
    "raised",
    metavar="NAME=SIZE",
    multiple=True,
    help="Raise a limit of what is read from a store, such as chunk=4GiB.  [repeatable]",
)
@click.pass_context
def cli(ctx: click.Context, *, raised: tuple[str, ...]) -> None:
    """Make datasets of simulated robot grasps, check them, view them and train on them."""
    if raised:
        limits.parse(",".join(raised))
        already = os.environ.get(limits.VARIABLE, "")
        os.environ[limits.VARIABLE] = ",".join([already, *raised])  # worker processes read it too
    if ctx.invoked_subcommand is None:
        click.echo(ctx.get_help())


for _heading, _commands in COMMANDS.items():
    cli.add_section(_heading, _commands)
