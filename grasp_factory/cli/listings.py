"""The commands that list tables: robots, policies, cameras, sensors and sets of objects."""

# ruff: noqa: PLC0415

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Protocol

import click

from grasp_factory.cli.params import AS_JSON, Command, option
from grasp_factory.cli.printing import print_json, say
from grasp_factory.core.config.factory_config import FactoryConfig
from grasp_factory.core.text_format import table
from grasp_factory.errors import EXIT_DONE, EXIT_FAILURE


class TableRow(Protocol):
    """A row of a table with a description."""

    @property
    def description(self) -> str:
        """One line that says what the row is."""


@click.command(
    cls=Command,
    examples=(
        "grasp-factory objects",
        "grasp-factory objects my_meshes",
        "grasp-factory objects my_meshes --robot panda --json",
    ),
)
@click.argument("folder", required=False, type=click.Path(path_type=Path))
@option(
    "--robot",
    metavar="NAME",
    default=FactoryConfig().robot,
    show_default=True,
    help="Robot whose gripper must be able to grasp the objects.",
)
@AS_JSON
@click.pass_context
def objects(ctx: click.Context, folder: Path | None, robot: str, as_json: bool) -> None:
    """List the object sets, or check a folder of meshes.

    Without FOLDER, lists the built-in object sets. With FOLDER, checks each URDF, OBJ, STL and PLY
    file in it and prints why a file cannot be used. Exits with 1 if none can be used. To simulate
    with these objects, run `grasp-factory generate --objects FOLDER`.
    """
    from grasp_factory.objects import OBJECT_SETS

    if folder is None:
        _print_table(_with_installed("object_sets", OBJECT_SETS), as_json=as_json)
        return
    from grasp_factory.cli.object_import import import_for
    from grasp_factory.objects.importing import import_report_text

    report = import_for(folder, robot)
    if as_json:
        print_json(report)
    else:
        say(import_report_text(report))
    ctx.exit(EXIT_DONE if report.usable else EXIT_FAILURE)


def listing(name: str, help: str, find: Callable[[], Mapping[str, TableRow]]) -> click.Command:
    """Return a command that lists a table, which ``find`` imports."""
    examples = (f"grasp-factory {name}", f"grasp-factory {name} --json")

    @click.command(name, cls=Command, help=help, examples=examples)
    @AS_JSON
    def command(as_json: bool) -> None:
        _print_table(find(), as_json=as_json)

    return command


def _robots() -> Mapping[str, TableRow]:
    from grasp_factory.robots import ROBOTS

    return _with_installed("robots", ROBOTS)


def _policies() -> Mapping[str, TableRow]:
    from grasp_factory.policies import POLICIES

    return _with_installed("policies", POLICIES)


def _cameras() -> Mapping[str, TableRow]:
    from grasp_factory.core.config.cameras import CAMERAS

    return CAMERAS


def _sensors() -> Mapping[str, TableRow]:
    from grasp_factory.core.sensors import SENSORS

    return _with_installed("sensors", SENSORS)


robots = listing(
    "robots",
    "List the robots.\n\nTheir names are values of `grasp-factory generate --robot`.",
    _robots,
)
policies = listing(
    "policies",
    "List the grasp policies.\n\nA policy chooses grasps from images. The names are values of"
    " `grasp-factory generate --policy`.",
    _policies,
)
cameras = listing(
    "cameras",
    "List the named cameras.\n\nThe names are values of `grasp-factory generate --camera`.",
    _cameras,
)
sensors = listing(
    "sensors",
    "List the sensors.\n\nThose of this package always record during an attempt. The names of"
    " others are values of `grasp-factory generate --sensor`.",
    _sensors,
)


def _with_installed(kind: str, table: Mapping[str, TableRow]) -> Mapping[str, TableRow]:
    """Return a table with the rows that installed packages offer."""
    from grasp_factory.core.plugins.entry_points import installed

    own = {name: plugin for name, plugin in installed(kind).items() if name not in table}
    return {**table, **own}


def _print_table(rows: Mapping[str, TableRow], *, as_json: bool) -> None:
    described = {name: row.description for name, row in rows.items()}
    if as_json:
        print_json(described)
    else:
        say(table(described.items()))
