"""The commands that list what there is: robots, policies, cameras, sensors, sets of objects."""

# ruff: noqa: PLC0415

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Protocol

import click

from grasp_factory.cli.params import AS_JSON, print_json
from grasp_factory.core.config.factory_config import FactoryConfig
from grasp_factory.core.text_format import table
from grasp_factory.errors import EXIT_DONE, EXIT_FAILURE


class TableRow(Protocol):
    """A row of a table, with a description of one line."""

    @property
    def description(self) -> str:
        """Text for the list."""


@click.command()
@click.argument("folder", required=False, type=click.Path(path_type=Path))
@click.option("--robot", default=FactoryConfig().robot, help="Whose gripper must hold them.")
@AS_JSON
@click.pass_context
def objects(ctx: click.Context, folder: Path | None, robot: str, as_json: bool) -> None:
    """List the sets of objects, or check a FOLDER of your own.

    Every URDF, OBJ, STL and PLY file of the folder can be used or is refused with a reason;
    exits with 1 if none can be used. `grasp-factory generate --objects FOLDER` drops them.
    """
    from grasp_factory.objects import OBJECT_SETS

    if folder is None:
        _print_table(OBJECT_SETS, as_json=as_json)
        return
    from grasp_factory.cli.object_import import import_for
    from grasp_factory.objects.importing import report_text

    report = import_for(folder, robot)
    if as_json:
        print_json(report)
    else:
        click.echo(report_text(report))
    ctx.exit(EXIT_DONE if report.usable else EXIT_FAILURE)


def listing(name: str, help: str, find: Callable[[], Mapping[str, TableRow]]) -> click.Command:
    """Return a command that lists a table, which ``find`` imports."""

    @click.command(name, help=help)
    @AS_JSON
    def command(as_json: bool) -> None:
        _print_table(find(), as_json=as_json)

    return command


def _robots() -> Mapping[str, TableRow]:
    from grasp_factory.robots import ROBOTS

    return ROBOTS


def _policies() -> Mapping[str, TableRow]:
    from grasp_factory.policies import POLICIES

    return POLICIES


def _cameras() -> Mapping[str, TableRow]:
    from grasp_factory.core.config.cameras import CAMERAS

    return CAMERAS


def _sensors() -> Mapping[str, TableRow]:
    from grasp_factory.core.sensors import SENSORS

    return SENSORS


robots = listing("robots", "List the robots.", _robots)
policies = listing("policies", "List the policies, which choose grasps from images.", _policies)
cameras = listing("cameras", "List the cameras that have names.", _cameras)
sensors = listing("sensors", "List the sensors that record during an attempt.", _sensors)


def _print_table(rows: Mapping[str, TableRow], *, as_json: bool) -> None:
    described = {name: row.description for name, row in rows.items()}
    if as_json:
        print_json(described)
    else:
        click.echo(table(described.items()))
