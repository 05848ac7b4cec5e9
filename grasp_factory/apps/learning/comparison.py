"""All baselines on one dataset: fitted on its train objects, scored on its test objects."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import combinations
from typing import Any

import numpy as np
from numpy.typing import NDArray

from grasp_factory import __version__
from grasp_factory.apps.learning.examples import ExampleReader, Examples
from grasp_factory.apps.learning.learning_stores import store_facts
from grasp_factory.apps.learning.progress_callback import ProgressWatch, unwatched
from grasp_factory.apps.learning.scores import FIGURES, Bootstrap, Estimate, auc
from grasp_factory.apps.learning.simple_baselines import majority, pose_only
from grasp_factory.apps.learning.training import Trained, TrainSettings, fit
from grasp_factory.core.geometry import Array
from grasp_factory.core.serialization import check, to_plain
from grasp_factory.dataset.dataset import Dataset
from grasp_factory.errors import ConfigError, UsageError, lookup
from grasp_factory.policies.networks import KINDS, TOUCH, WIDTH, TouchWindow
from grasp_factory.signals.grasp_crop import CropShape

ATTEMPTS, LIFTS = "attempts", "lifts"
POPULATIONS: Mapping[str, str] = {
    ATTEMPTS: "all episodes in which a grasp was planned",
    LIFTS: "those of them that got to the lift: will what is in the hand stay there?",
}
"""Touch carries information only where the gripper closed. So predictors with touch, and those that
they are compared with, are judged on these episodes."""
ABLATION = "vision_lifts"
"""A network of kind vision that learns from lifts alone: ``both`` without touch. The plain
``vision`` learns from all attempts, which have another share of successes."""
GAINS: Sequence[tuple[str, str, str]] = (
    (ATTEMPTS, "vision", "pose"),
    (LIFTS, "touch", ABLATION),
    (LIFTS, "both", ABLATION),
    (LIFTS, "both", "vision"),
    (LIFTS, "both", "touch"),
)
"""Population, the predictor whose AUC is compared, and the predictor that it is compared with."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Gain:
    """How much better one predictor's AUC is than another's on the same episodes."""

    population: str
    of: str
    over: str
    auc: Estimate


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Population:
    """Held-out episodes, and every predictor's probabilities and scores on them."""

    train_episodes: int
    """Number of episodes that the predictors learned from."""
    success: NDArray[np.bool_]
    """(K,)."""
    objects: int
    probabilities: Mapping[str, Array]
    """(K,) for each predictor."""
    scores: Mapping[str, Mapping[str, Estimate]]
    """By predictor, then by figure."""
    bootstrap: Bootstrap


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Comparison:
    """The results of a comparison of baselines."""

    populations: Mapping[str, Population]
    gains: tuple[Gain, ...]
    trained: Mapping[str, Trained]
    """By kind of network, and by ``ABLATION``."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Course:
    """Which networks are trained, and on which episodes."""

    kinds: Sequence[str] = tuple(KINDS)
    episodes: int | None = None
    """Number of train episodes: the first ones in which a grasp was planned; None for all."""
    rows: Sequence[int] | None = None
    """Rows of the train split that are used; None for all."""
    crop: CropShape = field(default_factory=CropShape)
    touch: TouchWindow = field(default_factory=TouchWindow)
    settings: TrainSettings = field(default_factory=TrainSettings)

    def __post_init__(self) -> None:
        for kind in self.kinds:
            lookup(KINDS, "baseline", kind)
        got = self.episodes
        check(got is None or got >= 1, "episodes", got, "1 or more")


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Splits:
    """The examples of one population."""

    train: Examples
    val: Examples
    test: Examples


def compare(
    dataset: Dataset, test: Dataset, course: Course, watch: ProgressWatch = unwatched
) -> Comparison:
    """Fit baselines on the train objects of a dataset and score them on the test objects.

    Args:
        dataset: Provides the train and val splits.
        test: Provides the test split; it may be the same dataset.
        course: What to train.
        watch: Reports the progress of reading and fitting.

    Raises:
        UsageError: if a split has too few episodes for training or evaluation.
    """
    kinds = {name: [k for k in course.kinds if population_of(k) == name] for name in POPULATIONS}
    plans = {name: mine for name, mine in kinds.items() if mine}
    parts = {
        name: read_splits(dataset, test, [*mine, *kinds[ATTEMPTS]], course, watch, population=name)
        for name, mine in plans.items()
    }  # read all examples before the first fit, so that missing ones are reported at once
    trained: dict[str, Trained] = {}
    populations: dict[str, Population] = {}
    for name, mine in plans.items():
        for kind in mine:
            trained[kind] = train_on(parts[name], kind, course, dataset, watch)
        if name == LIFTS and "vision" in trained:
            trained[ABLATION] = train_on(parts[name], "vision", course, dataset, watch)
        populations[name] = _judge(parts[name], trained, course.settings.seed)
    return Comparison(populations=populations, gains=_gains(populations), trained=trained)


def population_of(kind: str) -> str:
    """Return the population that a kind of network is trained and judged on."""
    return LIFTS if TOUCH in KINDS[kind] else ATTEMPTS


def read_splits(
    dataset: Dataset,
    test: Dataset,
    kinds: Iterable[str],
    course: Course,
    watch: ProgressWatch,
    *,
    population: str = ATTEMPTS,
) -> Splits:
    """Return the examples of a population with the inputs that some kinds of network need.

    Raises:
        UsageError: if a split has fewer episodes than requested, or episodes of one label only,
            or if an object is in two splits.
    """
    uses = list(dict.fromkeys(name for kind in kinds for name in KINDS[kind]))
    parts: dict[str, Examples] = {}
    for split, source in (("train", dataset), ("val", dataset), ("test", test)):
        reader = ExampleReader(dataset=source, uses=uses, crop=course.crop, touch=course.touch)
        planned = ExampleReader(dataset=source, uses=(WIDTH,))
        try:
            rows = planned.usable(source.split(split).indices)
            if split == "train" and course.rows is not None:
                rows = _chosen(rows, course.rows)
            if split == "train" and course.episodes is not None:
                valid = f"up to {len(rows)}, the train episodes with a grasp"
                check(course.episodes <= len(rows), "episodes", course.episodes, valid)
                rows = rows[: course.episodes]  # every population learns from the same episodes
            rows = reader.usable(rows)
        except ConfigError:
            raise
        except UsageError as error:
            raise UsageError(f"split {split}: {error}; generate more, or name another") from None
        _check_labels(source, split, population, rows)
        with watch(f"reading {split}", len(rows)) as step:
            parts[split] = reader.read(rows, step)
    for first, second in combinations(parts, 2):
        both = np.intersect1d(parts[first].object_id, parts[second].object_id)
        if len(both):
            what = f"object {both[0]} is in {first} and in {second}: nothing is held out"
            raise UsageError(f"{what}; name stores whose objects were split in the same way")
    return Splits(**parts)


def _chosen(rows: NDArray[np.int64], wanted: Sequence[int]) -> NDArray[np.int64]:
    """Return the rows that are in ``wanted``; other values of ``wanted`` are ignored."""
    found = rows[np.isin(rows, wanted)]
    if not len(found):
        what = f"rows: got {len(wanted)}, none of which is a train episode with a grasp"
        raise ConfigError(f"{what}; valid: some of the {len(rows)} that are")
    return found


def _check_labels(dataset: Dataset, split: str, population: str, rows: NDArray[np.int64]) -> None:
    good = int(dataset.column("success")[rows].sum())
    if not 0 < good < len(rows):
        last, there = dataset.paths[-1], int(dataset.starts[-1] - dataset.starts[-2])
        raise UsageError(
            f"split {split} of {dataset.name}: {good} of {len(rows)} {population} are a success;"
            " valid: some of both kinds; make more episodes, such as with"
            f" `grasp-factory generate --out {last} --n {max(400, 2 * there)}`"
        )


def train_on(
    splits: Splits, kind: str, course: Course, dataset: Dataset, watch: ProgressWatch = unwatched
) -> Trained:
    """Fit a network of one kind."""
    facts: dict[str, Any] = {
        "grasp_factory": __version__,
        **store_facts(dataset),
        "train_episodes": len(splits.train),
        "settings": to_plain(course.settings),
    }
    return fit(
        kind, splits.train, splits.val, course.settings,
        crop=course.crop, touch=course.touch, facts=facts, watch=watch,
    )  # fmt: skip


def _judge(splits: Splits, trained: Mapping[str, Trained], seed: int) -> Population:
    train, test = splits.train, splits.test
    probabilities = {
        "majority": majority(train, test),
        "pose": pose_only(train, test),
        **{kind: found.model.predict(test.inputs) for kind, found in trained.items()},
    }
    bootstrap = Bootstrap(test.success, test.object_id, seed)
    scores = {
        name: {label: bootstrap.estimate(figure, p) for label, figure in FIGURES.items()}
        for name, p in probabilities.items()
    }
    return Population(
        train_episodes=len(train),
        success=test.success,
        objects=len(np.unique(test.object_id)),
        probabilities=probabilities,
        scores=scores,
        bootstrap=bootstrap,
    )


def _gains(populations: Mapping[str, Population]) -> tuple[Gain, ...]:
    found = []
    for name, of, over in GAINS:
        if name in populations and {of, over} <= populations[name].probabilities.keys():
            p = populations[name].probabilities
            gain = populations[name].bootstrap.gain(auc, p[of], p[over])
            found.append(Gain(population=name, of=of, over=over, auc=gain))
    return tuple(found)
