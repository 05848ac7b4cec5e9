"""AUC against the number of training episodes: how much more data improves it."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from grasp_factory.apps.learning.comparison import Course, population_of, read_splits, train_on
from grasp_factory.apps.learning.examples import Examples
from grasp_factory.apps.learning.progress_callback import ProgressWatch, unwatched
from grasp_factory.apps.learning.report import estimate_text
from grasp_factory.apps.learning.scores import LEVEL, RANGE, Bootstrap, Estimate, auc, interval
from grasp_factory.apps.learning.simple_baselines import pose_only
from grasp_factory.core.geometry import Array
from grasp_factory.core.serialization import check
from grasp_factory.dataset.dataset import Dataset
from grasp_factory.errors import UsageError, lookup
from grasp_factory.policies.networks import KINDS


@dataclass(frozen=True, slots=True, kw_only=True)
class Steps:
    """Which networks are trained for a curve."""

    kind: str = "vision"
    sizes: tuple[int, ...] = (250, 1000, 4000)
    """Numbers of training episodes."""
    seeds: int = 3
    """Number of networks for each size, each with its own seed."""

    def __post_init__(self) -> None:
        lookup(KINDS, "baseline", self.kind)
        check(self.seeds >= 1, "seeds", self.seeds, "1 or more")
        ok = len(self.sizes) > 0 and self.sizes == tuple(sorted(set(self.sizes)))
        ok = ok and self.sizes[0] >= 2
        check(ok, "sizes", list(self.sizes), "numbers from 2, ascending, such as 250,1000,4000")


@dataclass(frozen=True, slots=True, kw_only=True)
class Curve:
    """AUC on held-out objects by number of training episodes."""

    sizes: tuple[int, ...]
    seeds: int
    test_episodes: int
    test_objects: int
    auc: Mapping[str, tuple[Estimate, ...]]
    """By predictor, at each size: the mean over seeds; the interval is over objects and seeds."""
    by_seed: Mapping[str, tuple[tuple[float, ...], ...]]
    """By predictor, at each size, for each seed."""


def learning_curve(
    dataset: Dataset, test: Dataset, steps: Steps, course: Course, watch: ProgressWatch = unwatched
) -> Curve:
    """Fit a network, and a regression on the pose alone, on random parts of the train split.

    Each seed draws other episodes and other initial weights. With one seed, a larger part contains
    the smaller ones. The best epoch is chosen on the whole val split at every size.

    Args:
        dataset: Provides the train and val splits.
        test: Provides the test split; it may be the same dataset.
        steps: Which network, and on how many episodes.
        course: How to train; its kinds and number of episodes are ignored.
        watch: Reports the progress of reading and fitting.

    Raises:
        UsageError: for a size that is larger than the train split, or too few episodes.
    """
    kind, sizes = steps.kind, steps.sizes
    whole = dataclasses.replace(course, episodes=None)
    population = population_of(kind)
    splits = read_splits(dataset, test, [kind], whole, watch, population=population)
    most = len(splits.train)
    if sizes[-1] > most:
        raise UsageError(f"sizes: got {sizes[-1]}, valid: up to {most}, the usable train episodes")
    answers: dict[str, list[list[Array]]] = {kind: [], "pose": []}
    for size in sizes:
        for found in answers.values():
            found.append([])
        for seed in range(steps.seeds):
            settings = dataclasses.replace(course.settings, seed=course.settings.seed + seed)
            part = dataclasses.replace(splits, train=_drawn(splits.train, size, settings.seed))
            own = dataclasses.replace(course, settings=settings)
            model = train_on(part, kind, own, dataset, watch).model
            answers[kind][-1].append(model.predict(splits.test.inputs))
            answers["pose"][-1].append(pose_only(part.train, splits.test))
    bootstrap = Bootstrap(splits.test.success, splits.test.object_id, course.settings.seed)
    return Curve(
        sizes=sizes,
        seeds=steps.seeds,
        test_episodes=len(splits.test),
        test_objects=len(np.unique(splits.test.object_id)),
        auc={
            name: tuple(
                interval(*bootstrap.over_networks(auc, at_size), *RANGE) for at_size in found
            )
            for name, found in answers.items()
        },
        by_seed={
            name: tuple(tuple(bootstrap.whole(auc, p) for p in at_size) for at_size in found)
            for name, found in answers.items()
        },
    )


def _drawn(examples: Examples, size: int, seed: int) -> Examples:
    """Return a random part of the examples, in their original order."""
    rows = np.sort(np.random.default_rng(seed).permutation(len(examples))[:size])
    return examples.take(rows)


def curve_text(curve: Curve) -> str:
    """Return a table with a row for each size."""
    names = list(curve.auc)
    rows = [["episodes", *(f"AUC of {name}" for name in names)]]
    for i, size in enumerate(curve.sizes):
        rows.append([str(size), *(estimate_text(curve.auc[name][i]) for name in names)])
    lines = ["".join(f"{cell:<26}" for cell in row).rstrip() for row in rows]
    about = (
        f"on {curve.test_episodes} held-out episodes of {curve.test_objects} objects; mean of"
        f" {curve.seeds} seeds, in brackets {LEVEL:.0%} over objects and seeds"
    )
    return "\n".join([*lines, about])
