"""The commands that train baseline models: ``train`` and ``learning-curve``."""

# ruff: noqa: PLC0415

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from itertools import pairwise
from pathlib import Path
from typing import Any, TextIO

import click

from grasp_factory.cli.params import STORE_PATH, Command, json_option, option, options
from grasp_factory.cli.printing import print_json, say
from grasp_factory.cli.row_choice import IDS
from grasp_factory.errors import UsageError, shown

_training = partial(option, heading="Training")
_output = partial(option, heading="Output")

STORES = click.argument("paths", metavar="PATH...", nargs=-1, required=True, type=STORE_PATH)

learning_options = options(
    IDS,
    _training(
        "--test",
        type=STORE_PATH,
        metavar="PATH",
        multiple=True,
        help="Store whose test split the models are evaluated on. Repeatable.  [default: the same"
        " stores]",
    ),
    _training(
        "--noise",
        metavar="NAME",
        help="Sensor noise that is added to the inputs, see docs/guides/noise.md.  [default: none]",
    ),
    _training(
        "--seed",
        metavar="SEED",
        type=int,
        default=0,
        show_default=True,
        help="Seed of the initial weights and of the order of examples.",
    ),
    _training("--epochs", metavar="N", type=int, help="Largest number of epochs.  [default: 20]"),
    _training("--threads", metavar="N", type=int, help="Threads of PyTorch.  [default: 1]"),
)
"""Adds the options of training."""


@click.command(
    cls=Command,
    examples=(
        "grasp-factory train grasps.zarr",
        "grasp-factory train monday.zarr tuesday.zarr --test held_out.zarr",
        "grasp-factory train grasps.zarr --baseline vision --epochs 5 --out vision",
    ),
)
@STORES
@_training(
    "--baseline",
    "kinds",
    metavar="NAME",
    multiple=True,
    help="Baseline: vision, touch or both. Repeatable.  [default: all three]",
)
@_training(
    "--episodes",
    metavar="N",
    type=int,
    help="Train on the first N episodes of the train split.  [default: all]",
)
@learning_options
@_output(
    "--out",
    metavar="DIR",
    type=click.Path(path_type=Path),
    default="baselines",
    show_default=True,
    help="New folder for weights, report and plots.",
)
@json_option("Output")
def train(
    *,
    paths: tuple[Path, ...],
    out: Path,
    kinds: tuple[str, ...],
    episodes: int | None,
    test: tuple[Path, ...],
    ids: TextIO | None,
    as_json: bool,
    **options: Any,
) -> None:
    """Train baseline models and test them on unseen objects.

    Trains on the train split of the stores at PATH, read as one, and evaluates on the objects of
    their test split. The input of vision is the depth image before the attempt, the input of touch
    the forces and torques on the pads until the lift, and both has both inputs. The table also has
    baselines without training. --ids selects training episodes only, not those of validation and
    test.
    """
    _check_libraries()
    from grasp_factory.apps.learning import plots
    from grasp_factory.apps.learning.comparison import Course, compare
    from grasp_factory.apps.learning.report import report_of, training_report_text
    from grasp_factory.cli.bars import watched
    from grasp_factory.policies.networks import save_model

    settings, noise = _settings(options), options["noise"]
    course = Course(kinds=kinds or Course().kinds, episodes=episodes, settings=settings)
    dataset, judge = _opened(paths, test, noise)
    course = replace(course, rows=_selection(ids, dataset))
    _new_folder(out)
    found = compare(dataset, judge, course, watched)
    report = report_of(found, _about(dataset, judge, noise, course))
    for kind, fitted in found.trained.items():
        (out / f"{kind}.safetensors").write_bytes(save_model(fitted.model))
    plots.plot_roc(out / "roc.png", found.populations)
    plots.plot_calibration(out / "calibration.png", found.populations)
    _write(out / "report.json", report)
    if as_json:
        print_json(report)
        return
    say(training_report_text(report))
    say(f"the weights, report.json, roc.png and calibration.png are in {out}")


@click.command(
    "learning-curve",
    cls=Command,
    examples=(
        "grasp-factory learning-curve grasps.zarr --sizes 100,300",
        "grasp-factory learning-curve grasps.zarr --baseline touch --seeds 5 --out tc",
    ),
)
@STORES
@_training(
    "--sizes",
    metavar="N,N,...",
    default="250,1000,4000",
    show_default=True,
    help="Numbers of training episodes.",
)
@_training(
    "--seeds",
    metavar="N",
    type=int,
    default=3,
    show_default=True,
    help="Models per size, each with another seed.",
)
@_training(
    "--baseline",
    "kind",
    metavar="NAME",
    default="vision",
    show_default=True,
    help="Baseline: vision, touch or both.",
)
@learning_options
@_output(
    "--out",
    metavar="DIR",
    type=click.Path(path_type=Path),
    default="learning-curve",
    show_default=True,
    help="New folder for table and plot.",
)
@json_option("Output")
def learning_curve(
    *,
    paths: tuple[Path, ...],
    out: Path,
    sizes: str,
    seeds: int,
    kind: str,
    test: tuple[Path, ...],
    ids: TextIO | None,
    as_json: bool,
    **options: Any,
) -> None:
    """Plot model accuracy against the number of episodes.

    Trains models on random parts of the train split of the stores at PATH, read as one, of several
    sizes and with several seeds for each size, and evaluates them on their test split.
    """
    _check_libraries()
    from grasp_factory.apps.learning import plots
    from grasp_factory.apps.learning.comparison import Course
    from grasp_factory.apps.learning.curve import Steps, curve_text
    from grasp_factory.apps.learning.curve import learning_curve as measure
    from grasp_factory.cli.bars import watched
    from grasp_factory.core.serialization import to_plain

    settings, noise = _settings(options), options["noise"]
    steps = Steps(kind=kind, sizes=_numbers(sizes), seeds=seeds)
    dataset, judge = _opened(paths, test, noise)
    course = Course(kinds=(kind,), rows=_selection(ids, dataset), settings=settings)
    _new_folder(out)
    curve = measure(dataset, judge, steps, course, watched)
    report = {
        **_about(dataset, judge, noise, course),
        "curve": to_plain(curve),
    }
    title = f"{curve.test_episodes} episodes of {curve.test_objects} objects, {curve.seeds} seeds"
    plots.plot_curve(out / "learning-curve.png", curve.sizes, curve.auc, title)
    _write(out / "learning-curve.json", report)
    if as_json:
        print_json(report)
        return
    say(curve_text(curve))
    say(f"learning-curve.json and learning-curve.png are in {out}")


def _opened(paths: Sequence[Path], test: Sequence[Path], noise: str | None) -> tuple[Any, Any]:
    from grasp_factory.apps.learning.learning_stores import open_stores

    dataset = open_stores(paths, noise)
    return dataset, open_stores(test, noise) if test else dataset


def _selection(ids: TextIO | None, dataset: Any) -> tuple[int, ...] | None:
    """Return the listed rows of the dataset; rows beyond the end of their store are left out."""
    from grasp_factory.dataset.selection import read_selections

    if ids is None:
        return None
    spans = pairwise(dataset.starts.tolist())
    listed = zip(spans, read_selections(ids, dataset.paths), strict=True)
    return tuple(
        start + row for (start, stop), rows in listed for row in rows if start + row < stop
    )


def _check_libraries() -> None:
    from grasp_factory.core.optional import require

    require("torch", "safetensors", "sklearn", "matplotlib", extra="train")


def _settings(options: dict[str, Any]) -> Any:
    from grasp_factory.apps.learning.training import TrainSettings

    given = {key: options[key] for key in ("seed", "epochs", "threads")}
    return TrainSettings(**{key: value for key, value in given.items() if value is not None})


def _about(dataset: Any, judge: Any, noise: str | None, course: Any) -> dict[str, Any]:
    """Return the origin of a report; without a time of day, so that equal runs have equal bytes."""
    from grasp_factory import __version__
    from grasp_factory.apps.learning.learning_stores import named_stores
    from grasp_factory.core.serialization import to_plain

    return {
        "grasp_factory": __version__,
        "store": named_stores(dataset),
        "test": named_stores(judge),
        "noise": noise,
        "course": to_plain(course),
    }


def _new_folder(out: Path) -> None:
    """Make the folder, before the slow reading begins.

    Raises:
        UsageError: if it is not empty, is inside a store, or cannot be made.
    """
    from grasp_factory.core.output_file import is_in_store

    if out.exists() and (not out.is_dir() or any(out.iterdir())):
        raise UsageError(f"{out} exists and is not an empty folder: choose another one with --out")
    if is_in_store(out):
        raise UsageError(f"{out} is inside a store: choose another folder with --out")
    try:
        out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        what = f"{out} cannot be made: {error.strerror}"
        raise UsageError(f"{what}; choose another folder with --out") from None


def _numbers(text: str) -> tuple[int, ...]:
    try:
        return tuple(int(word) for word in text.split(","))
    except ValueError:
        what = f"--sizes: got {shown(text)}"
        raise UsageError(f"{what}, valid: numbers such as 250,1000,4000") from None


def _write(path: Path, report: dict[str, Any]) -> None:
    path.write_text(json.dumps(report, indent=2) + "\n", encoding="utf-8")
