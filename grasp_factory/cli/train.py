"""The commands that train baseline models: ``train`` and ``learning-curve``."""

# ruff: noqa: PLC0415

from __future__ import annotations

import json
from functools import partial
from pathlib import Path
from typing import Any, TextIO

import click

from grasp_factory.cli.params import STORE, STORE_PATH, Command, json_option, option, options
from grasp_factory.cli.printing import print_json, say
from grasp_factory.cli.row_choice import IDS
from grasp_factory.errors import UsageError, shown

_training = partial(option, heading="Training")
_output = partial(option, heading="Output")

learning_options = options(
    IDS,
    _training(
        "--test",
        type=STORE_PATH,
        metavar="PATH",
        help="Store whose test split the models are evaluated on.  [default: the same store]",
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
        "grasp-factory train grasps.zarr --baseline vision --epochs 5 --out vision",
    ),
)
@STORE
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
    path: Path,
    out: Path,
    kinds: tuple[str, ...],
    episodes: int | None,
    test: Path | None,
    ids: TextIO | None,
    as_json: bool,
    **options: Any,
) -> None:
    """Train baseline models and test them on unseen objects.

    Trains on the train split of the store at PATH and evaluates on the objects of its test split.
    The input of vision is the depth image before the attempt, the input of touch the forces and
    torques on the pads until the lift, and both has both inputs. The table also has baselines
    without training. --ids selects training episodes only, not those of validation and test.
    """
    _check_libraries()
    from grasp_factory.apps.learning import plots
    from grasp_factory.apps.learning.comparison import Course, compare
    from grasp_factory.apps.learning.report import report_of, training_report_text
    from grasp_factory.cli.bars import watched
    from grasp_factory.policies.networks import save_model

    settings, noise = _settings(options), options["noise"]
    course = Course(
        kinds=kinds or Course().kinds,
        episodes=episodes,
        rows=_selection(ids, path),
        settings=settings,
    )
    dataset, judge = _open(path, test, noise)
    _new_folder(out)
    found = compare(dataset, judge, course, watched)
    report = report_of(found, _about((path, dataset), (test or path, judge), noise, course))
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
@STORE
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
    path: Path,
    out: Path,
    sizes: str,
    seeds: int,
    kind: str,
    test: Path | None,
    ids: TextIO | None,
    as_json: bool,
    **options: Any,
) -> None:
    """Plot model accuracy against the number of episodes.

    Trains models on random parts of the train split of the store at PATH, of several sizes and with
    several seeds for each size, and evaluates them on its test split.
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
    course = Course(kinds=(kind,), rows=_selection(ids, path), settings=settings)
    dataset, judge = _open(path, test, noise)
    _new_folder(out)
    curve = measure(dataset, judge, steps, course, watched)
    report = {
        **_about((path, dataset), (test or path, judge), noise, course),
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


def _selection(ids: TextIO | None, path: Path) -> tuple[int, ...] | None:
    from grasp_factory.dataset.selection import read_selection

    return None if ids is None else tuple(read_selection(ids, path))


def _check_libraries() -> None:
    from grasp_factory.core.optional import require

    require("torch", "safetensors", "sklearn", "matplotlib", extra="train")


def _settings(options: dict[str, Any]) -> Any:
    from grasp_factory.apps.learning.training import TrainSettings

    given = {key: options[key] for key in ("seed", "epochs", "threads")}
    return TrainSettings(**{key: value for key, value in given.items() if value is not None})


def _open(path: Path, test: Path | None, noise: str | None) -> tuple[Any, Any]:
    from grasp_factory.dataset.dataset import Dataset

    dataset = Dataset(path, noise=noise)
    return dataset, Dataset(test, noise=noise) if test else dataset


def _about(
    store: tuple[Path, Any], test: tuple[Path, Any], noise: str | None, course: Any
) -> dict[str, Any]:
    """Return the origin of a report; without a time of day, so that equal runs have equal bytes."""
    from grasp_factory import __version__
    from grasp_factory.core.serialization import to_plain

    return {
        "grasp_factory": __version__,
        "store": _named(*store),
        "test": _named(*test),
        "noise": noise,
        "course": to_plain(course),
    }


def _named(path: Path, dataset: Any) -> dict[str, str]:
    from grasp_factory.curation.versions.origin import states_of

    named = {"path": str(path), "config_sha256": dataset.config.sha256()}
    for state in states_of([path]):
        named |= {"rows_sha256": state.rows_sha256, "snapshot": state.snapshot}
    return named


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
