"""The command that measures the accuracy of the physics: ``check-physics``."""

# ruff: noqa: PLC0415

from __future__ import annotations

import sys
from collections.abc import Iterable
from typing import TYPE_CHECKING

import click

from grasp_factory.cli.params import AS_JSON, Command, option
from grasp_factory.cli.printing import print_json, say
from grasp_factory.core.serialization import to_plain
from grasp_factory.core.text_format import table
from grasp_factory.errors import EXIT_DONE, EXIT_FAILURE

if TYPE_CHECKING:
    from grasp_factory.apps.physics_check.figure import Figure


@click.command(
    "check-physics",
    cls=Command,
    examples=("grasp-factory check-physics --short", "grasp-factory check-physics --json"),
)
@option("--short", is_flag=True, help="Use fewer episodes: one minute instead of ten.")
@AS_JSON
def check_physics(short: bool, as_json: bool) -> None:
    """Measure the accuracy of forces and labels.

    Simulates test cases on this machine and prints each result with its bound. Exits with 1 if a
    result is out of bounds.
    """
    from grasp_factory.apps.physics_check import FULL, SHORT
    from grasp_factory.apps.physics_check import check_physics as run

    figures = list(run(SHORT if short else FULL, lambda part: say(f"{part} ...", err=True)))
    if as_json:
        print_json([to_plain(f) | {"passes": f.passes, "bound": f.bound} for f in figures])
    else:
        say(figures_text(figures))
    sys.exit(EXIT_DONE if all(f.passes for f in figures) else EXIT_FAILURE)


def figures_text(figures: Iterable[Figure]) -> str:
    """Return a table of the measured figures and their bounds."""
    head = ("check", "figure", "value", "bound", "samples", "")
    rows = [
        (f.check, f.figure, f"{f.value:.3g} {f.unit}", f.bound, f.samples,
         "ok" if f.passes else "MISSED")
        for f in figures
    ]  # fmt: skip
    return table([head, *rows], right=(2, 4))
