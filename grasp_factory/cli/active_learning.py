"""The command that closes the loop: rounds of generate, train and generate."""

# ruff: noqa: PLC0415

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import click

from grasp_factory.cli.options import dataset_options, request_from
from grasp_factory.cli.params import AS_JSON
from grasp_factory.errors import EXIT_INTERRUPTED, EXIT_TERMINATED, Terminated


@click.command()
@click.argument("out", type=click.Path(path_type=Path))
@click.option("--rounds", type=int, default=3, show_default=True, help="After round 0.")
@click.option(
    "--start",
    type=int,
    default=500,
    show_default=True,
    help="Episodes of round 0, by the policies of the config.",
)
@click.option(
    "--budget", type=int, default=500, show_default=True, help="Episodes of each later round."
)
@click.option(
    "--eval",
    "evaluation",
    type=int,
    default=1000,
    show_default=True,
    help="Episodes with objects of the test split, on which all models are judged.",
)
@click.option(
    "--select",
    type=click.Choice(["active", "random", "both"]),
    default="both",
    show_default=True,
    help="Grasps that the model is unsure about, random ones, or an arm of each.",
)
@click.option(
    "--try",
    "tries",
    type=int,
    default=0,
    show_default=True,
    help="Episodes with objects of the test split in which the last models choose the grasps.",
)
@click.option(
    "--seeds",
    type=int,
    default=3,
    show_default=True,
    help="Models that are trained a round; the first chooses, the figures are of all.",
)
@click.option("--epochs", type=int, default=20, show_default=True, help="Of training, at most.")
@click.option("--workers", type=int, help="Processes that make episodes.  [default: 2]")
@dataset_options
@AS_JSON
def flywheel(
    out: Path,
    *,
    rounds: int,
    start: int,
    budget: int,
    evaluation: int,
    select: str,
    tries: int,
    seeds: int,
    epochs: int,
    as_json: bool,
    **options: Any,
) -> None:
    """Let a model choose the grasps that it learns from.

    Round 0 makes episodes with the policies of the config and trains a model; each later round
    lets the policy `learned` choose new grasps with the model of the round before, and trains on
    all so far. The folder OUT gets stores, models, flywheel.json and flywheel.png. The same
    command goes on where it was stopped.
    """
    from grasp_factory.core.optional import require

    require("torch", "safetensors", "sklearn", "matplotlib", extra="train")
    from grasp_factory.apps.active_learning import FlywheelSettings, run_rounds
    from grasp_factory.apps.active_learning.journal import FILE
    from grasp_factory.apps.active_learning.text import flywheel_text
    from grasp_factory.cli.progress import watched
    from grasp_factory.cli.run_progress import make

    request = request_from(**options)
    settings = FlywheelSettings(
        config=request.config, rounds=rounds, start=start, budget=budget, evaluation=evaluation,
        select=select, tries=tries, seeds=seeds, epochs=epochs,
    )  # fmt: skip
    try:
        found = run_rounds(
            settings,
            out,
            request.workers,
            make=lambda asked: make(asked, quiet=False),
            watch=watched,
        )
    except KeyboardInterrupt as why:
        said = f"Stopped: what is made stays in {out}; run the same command again to go on."
        click.echo(said, err=True)
        sys.exit(EXIT_TERMINATED if isinstance(why, Terminated) else EXIT_INTERRUPTED)
    if as_json:
        click.echo((out / FILE).read_text(encoding="utf-8"), nl=False)
    else:
        click.echo(flywheel_text(found))
        click.echo(f"\nflywheel.json and flywheel.png are in {out}")
