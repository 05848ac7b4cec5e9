"""The command for active learning, rounds of generate and train: ``flywheel``."""

# ruff: noqa: PLC0415

from __future__ import annotations

import sys
from functools import partial
from pathlib import Path
from typing import Any

import click

from grasp_factory.cli.options import dataset_options
from grasp_factory.cli.params import Command, json_option, option
from grasp_factory.cli.printing import say
from grasp_factory.cli.request import request_from
from grasp_factory.errors import EXIT_INTERRUPTED, EXIT_TERMINATED, Terminated

_rounds = partial(option, heading="Rounds", show_default=True)
_training = partial(option, heading="Training", show_default=True)


@click.command(
    cls=Command,
    examples=(
        "grasp-factory flywheel loop",
        "grasp-factory flywheel small --rounds 2 --start 200 --budget 200 --eval 300",
        "grasp-factory flywheel active --select active --try 500 --objects procedural",
    ),
)
@click.argument("out", type=click.Path(path_type=Path))
@_rounds("--rounds", metavar="N", type=int, default=3, help="Rounds after round 0.")
@_rounds("--start", metavar="N", type=int, default=500, help="Episodes of round 0.")
@_rounds("--budget", metavar="N", type=int, default=500, help="Episodes of each later round.")
@_rounds(
    "--eval",
    "evaluation",
    metavar="N",
    type=int,
    default=1000,
    help="Episodes with objects of the test split that all models are evaluated on.",
)
@_rounds(
    "--select",
    type=click.Choice(["active", "random", "both"]),
    default="both",
    help="New grasps: those with the most uncertain prediction, random ones, or both in two"
    " separate arms.",
)
@_rounds(
    "--try",
    "tries",
    metavar="N",
    type=int,
    default=0,
    help="Episodes with objects of the test split in which the last models choose the grasps.",
)
@_rounds(
    "--workers",
    metavar="N",
    type=int,
    show_default=False,
    help="Worker processes that make episodes.  [default: 2]",
)
@_training(
    "--seeds",
    metavar="N",
    type=int,
    default=3,
    help="Models per round, each with another seed. The first one chooses grasps; results are over"
    " all of them.",
)
@_training("--epochs", metavar="N", type=int, default=20, help="Largest number of epochs.")
@dataset_options
@json_option("Output")
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
    """Train a model that chooses its own training grasps.

    Runs rounds of active learning. Round 0 makes episodes with the policies of the config and
    trains a model. In each later round, the policy `learned` chooses new grasps with the model of
    the round before, and a new model is trained on all episodes so far. Writes stores, models,
    flywheel.json and flywheel.png to the folder OUT. To continue a stopped run, run the same
    command again.
    """
    from grasp_factory.core.optional import require

    require("torch", "safetensors", "sklearn", "matplotlib", extra="train")
    from grasp_factory.apps.active_learning import FlywheelSettings, run_rounds
    from grasp_factory.apps.active_learning.journal import FILE
    from grasp_factory.apps.active_learning.text import flywheel_text
    from grasp_factory.cli.bars import watched
    from grasp_factory.cli.run_progress import RunProgress, make

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
            make=lambda asked: make(asked, RunProgress(quiet=False)),
            watch=watched,
        )
    except KeyboardInterrupt as why:
        note = f"Stopped: finished episodes stay in {out}; run the same command again to continue."
        say(note, err=True)
        sys.exit(EXIT_TERMINATED if isinstance(why, Terminated) else EXIT_INTERRUPTED)
    if as_json:
        say((out / FILE).read_text(encoding="utf-8"), end="")
    else:
        say(flywheel_text(found))
        say(f"\nflywheel.json and flywheel.png are in {out}")
