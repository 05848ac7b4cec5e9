"""The commands that learn from a store: baselines, and what more data is worth."""

# ruff: noqa: PLC0415

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any, TextIO, TypeVar

import click

from grasp_factory.cli.params import AS_JSON, IDS, STORE, print_json
from grasp_factory.core.output_file import is_in_store
from grasp_factory.errors import UsageError, shown

F = TypeVar("F", bound=Callable[..., Any])

_OPTIONS = (
    IDS,
    click.option(
        "--test",
        type=click.Path(path_type=Path),
        metavar="PATH",
        help="Another store, whose test split judges.  [default: the same]",
    ),
    click.option("--seed", type=int, default=0, show_default=True, help="Of weights and order."),
    click.option("--epochs", type=int, help="At most.  [default: 20]"),
    click.option("--threads", type=int, help="Of torch.  [default: 1]"),
    click.option("--noise", help="What sensors add when examples are read: see docs/noise.md."),
)


def learning_options(command: F) -> F:
    """Add the options that say how to train."""
    for option in reversed(_OPTIONS):
        command = option(command)
    return command


@click.command()
@STORE
@click.option(
    "--out",
    type=click.Path(path_type=Path),
    default="baselines",
    show_default=True,
    help="New folder for weights, report and plots.",
)
@click.option(
    "--baseline",
    "kinds",
    metavar="NAME",
    multiple=True,
    help="vision, touch or both; repeatable.  [default: all three]",
)
@click.option("--episodes", type=int, help="Of the train split, the first.  [default: all]")
@learning_options
@AS_JSON
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
    """Train baselines on the store at PATH and judge them on its held-out objects.

    vision sees the depth image before the attempt, touch the pads' wrenches until the lift, both
    sees both. The table has what needs no learning beside them. With --ids, only these rows of the
    train split are learned from; what chooses weights and judges stays whole.
    """
    _check_libraries()
    from grasp_factory.apps.learning import plots
    from grasp_factory.apps.learning.comparison import Course, compare
    from grasp_factory.apps.learning.report import report_of, report_text
    from grasp_factory.cli.progress import watched
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
    click.echo(report_text(report))
    click.echo(f"weights, report.json, roc.png and calibration.png are in {out}")


@click.command("learning-curve")
@STORE
@click.option(
    "--out",
    type=click.Path(path_type=Path),
    default="learning-curve",
    show_default=True,
    help="New folder for table and plot.",
)
@click.option("--sizes", default="250,1000,4000", show_default=True, help="Training episodes.")
@click.option("--seeds", type=int, default=3, show_default=True, help="How often all is done.")
@click.option(
    "--baseline",
    "kind",
    metavar="NAME",
    default="vision",
    show_default=True,
    help="vision, touch or both.",
)
@learning_options
@AS_JSON
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
    """Train on more and more of the store at PATH and plot what it is worth.

    Each size is trained with several seeds, each on another random part of the train split.
    """
    _check_libraries()
    from grasp_factory.apps.learning import plots
    from grasp_factory.apps.learning.comparison import Course
    from grasp_factory.apps.learning.curve import Steps, curve_text
    from grasp_factory.apps.learning.curve import learning_curve as measure
    from grasp_factory.cli.progress import watched
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
    click.echo(curve_text(curve))
    click.echo(f"learning-curve.json and learning-curve.png are in {out}")


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

    dataset = Dataset.open(path, noise=noise)
    return dataset, Dataset.open(test, noise=noise) if test else dataset


def _about(
    store: tuple[Path, Any], test: tuple[Path, Any], noise: str | None, course: Any
) -> dict[str, Any]:
    """Return what a report says of where it comes from; no time of day, so that runs compare."""
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
    return {"path": str(path), "config_sha256": dataset.config.sha256()}


def _new_folder(out: Path) -> None:
    """Make the folder, before anything is read that takes long.

    Raises:
        UsageError: if something would be overwritten, or it cannot be made.
    """
    if out.exists() and (not out.is_dir() or any(out.iterdir())):
        raise UsageError(f"{out} is there already; give another folder with --out")
    if is_in_store(out):
        raise UsageError(f"{out} is inside a store, which holds data only; give another with --out")
    try:
        out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise UsageError(f"{out} cannot be made: {error.strerror}; give another --out") from None


def _numbers(text: str) -> tuple[int, ...]:
    try:
        return tuple(int(word) for word in text.split(","))
    except ValueError:
        raise UsageError(f"--sizes {shown(text)}: expected numbers such as 250,1000,4000") from None


def _write(path: Path, report: dict[str, Any]) -> None:
    path.write_text(json.dumps(report, indent=2) + "\n", encoding="utf-8")
