"""The command that measures the quality of a recorded session: ``capture check``."""

# ruff: noqa: PLC0415

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import click

from grasp_factory.cli.params import AS_JSON, Command
from grasp_factory.cli.printing import print_json, say, say_lines
from grasp_factory.core.config.quality import quality_text
from grasp_factory.core.optional import require
from grasp_factory.core.serialization import to_plain
from grasp_factory.core.text_format import percent, table

if TYPE_CHECKING:
    from grasp_factory.capture.quality.session_check import SessionCheck

_HEAD = ("topic", "samples", "rate", "gap", "lost", "saturated")


@click.command(
    cls=Command,
    examples=(
        "grasp-factory capture check session_1",
        "grasp-factory capture check session_1 --json",
    ),
)
@click.argument("session", type=click.Path(path_type=Path))
@AS_JSON
@click.pass_context
def check(ctx: click.Context, session: Path, *, as_json: bool) -> None:
    """Measure the quality of a recorded session.

    Prints rate, gaps and losses of every stream, the measures behind the quality score, and the
    score from 1 to 5. Exits with 1 if a tolerance is missed.
    """
    require("mcap", "rosbags", extra="capture")
    from grasp_factory.capture.quality.session_check import check_session
    from grasp_factory.writers.exporters.json_file import finite

    found = check_session(session)
    if as_json:
        print_json(finite(to_plain(found)))
    else:
        _print(session, found)
    ctx.exit(1 if found.shortcomings else 0)


def _print(session: Path, found: SessionCheck) -> None:
    rows = [
        (
            stream.topic,
            stream.samples,
            _number(stream.rate, "Hz"),
            _number(stream.gap, "periods"),
            percent(None if math.isnan(stream.lost) else stream.lost),
            percent(None if math.isnan(stream.saturated) else stream.saturated),
        )
        for stream in found.streams
    ]
    say(table([_HEAD, *rows], right=range(1, len(_HEAD))))
    say_lines(_lines(session, found))


def _lines(session: Path, found: SessionCheck) -> Iterator[str]:
    for name, value in to_plain(found.inspection).items():
        yield f"{name}: {_number(value)}"
    for text in found.shortcomings:
        yield f"missed: {text}"
    yield f"{session}: quality {quality_text(found.score)}"


def _number(value: float, unit: str = "") -> str:
    return "-" if math.isnan(value) else f"{value:.4g} {unit}".strip()
