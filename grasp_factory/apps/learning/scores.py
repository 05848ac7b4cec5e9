"""Scores of predicted probabilities, with confidence intervals over objects, not episodes."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from grasp_factory.core.geometry import Array

RESAMPLES = 1000
LEVEL = 0.95
RANGE = (0.0, 1.0)
"""Lowest and highest value of every score."""
BINS = 15
"""Number of bins of equal width for the calibration error."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Estimate:
    """A figure with its 95 % interval."""

    value: float
    low: float
    high: float


Truth = NDArray[np.bool_]
ScoreFunction = Callable[[Truth, Array, Array], Array]
"""Takes labels (K,), probabilities (K,) and R sets of weights (R, K); returns R scores, (R,).

scikit-learn's functions take one set of weights, and a millisecond for each call. That is too slow
for a thousand resamples of every predictor. The tests compare these functions with scikit-learn's.
"""


def auc(success: Truth, probability: Array, weight: Array) -> Array:
    """Return the area under the ROC: how often a success is ranked above a failure."""
    good, bad = _by_value(success, probability, weight)
    below = np.cumsum(bad, axis=1) - bad / 2.0  # equal probabilities count half
    return np.asarray((good * below).sum(axis=1) / (good.sum(axis=1) * bad.sum(axis=1)))


def average_precision(success: Truth, probability: Array, weight: Array) -> Array:
    """Return the mean precision over the successes, each at its own rank."""
    good, bad = (part[:, ::-1] for part in _by_value(success, probability, weight))
    hits = np.cumsum(good, axis=1)
    taken = np.maximum(hits + np.cumsum(bad, axis=1), np.finfo(float).tiny)
    return np.asarray((good * hits / taken).sum(axis=1) / hits[:, -1])


def accuracy(success: Truth, probability: Array, weight: Array) -> Array:
    """Return the share of episodes that a threshold of 0.5 classifies correctly."""
    return np.asarray(weight @ ((probability >= 0.5) == success) / weight.sum(axis=1))


def calibration_error(success: Truth, probability: Array, weight: Array) -> Array:
    """Return the expected calibration error (Naeini et al., 2015).

    It is the gap between mean probability and success rate in a bin, averaged over the episodes.
    """
    bins = np.minimum((probability * BINS).astype(int), BINS - 1)
    gaps = np.zeros((len(probability), BINS))
    gaps[np.arange(len(bins)), bins] = success - probability
    return np.asarray(np.abs(weight @ gaps).sum(axis=1) / weight.sum(axis=1))


def _by_value(success: Truth, probability: Array, weight: Array) -> tuple[Array, Array]:
    """Return the weights of successes and failures at each distinct probability, ascending."""
    order = np.argsort(probability, kind="stable")
    starts = np.flatnonzero(np.diff(probability[order], prepend=-np.inf))
    sorted_weight, sorted_success = weight[:, order], success[order]
    return (
        np.add.reduceat(sorted_weight * sorted_success, starts, axis=1),
        np.add.reduceat(sorted_weight * ~sorted_success, starts, axis=1),
    )


FIGURES: Mapping[str, ScoreFunction] = {
    "auc": auc,
    "average_precision": average_precision,
    "accuracy": accuracy,
    "calibration_error": calibration_error,
}


class Bootstrap:
    """Resamples of a population's objects: episodes with the same object are not independent.

    Every predictor is scored on the same resamples, so that differences are paired.
    """

    def __init__(self, success: Truth, object_id: NDArray[np.str_], seed: int) -> None:
        """Draw the resamples.

        Args:
            success: Labels (K,), of both classes.
            object_id: Object of each episode, (K,).
            seed: Seed of the resamples.
        """
        self._success = success
        names, episode_object = np.unique(object_id, return_inverse=True)
        weight = object_resamples(len(names), seed)[:, episode_object].astype(np.float64)
        good = weight @ success
        self._weight = weight[(good > 0.0) & (good < weight.sum(axis=1))]  # others have no AUC

    def estimate(self, figure: ScoreFunction, probability: Array) -> Estimate:
        """Return a figure of a predictor's probabilities (K,) with its interval."""
        drawn = self.over_resamples(figure, probability)
        return interval(self.whole(figure, probability), drawn, *RANGE)

    def gain(self, figure: ScoreFunction, better: Array, worse: Array) -> Estimate:
        """Return by how much a figure of one predictor exceeds that of another."""
        drawn = self.over_resamples(figure, better) - self.over_resamples(figure, worse)
        return interval(self.whole(figure, better) - self.whole(figure, worse), drawn)

    def whole(self, figure: ScoreFunction, probability: Array) -> float:
        """Return a figure over all episodes."""
        return float(figure(self._success, probability, np.ones((1, len(probability))))[0])

    def over_resamples(self, figure: ScoreFunction, probability: Array) -> Array:
        """Return a figure over each resample, (R,)."""
        return figure(self._success, probability, self._weight)

    def over_networks(self, figure: ScoreFunction, answers: Sequence[Array]) -> tuple[float, Array]:
        """Return the mean of a figure over some networks, and its value on each resample, (R,).

        Each network has its probabilities (K,). Each resample of the objects also draws networks,
        by their position in the list. So the figures of two lists of equal length are paired.
        """
        each = np.array([self.over_resamples(figure, p) for p in answers])
        picks = np.random.default_rng(0).integers(len(answers), size=each.shape)
        whole = float(np.mean([self.whole(figure, p) for p in answers]))
        return whole, np.take_along_axis(each, picks, axis=0).mean(axis=0)


def object_resamples(count: int, seed: int) -> NDArray[np.int64]:
    """Return how often each of ``count`` objects is drawn in each resample, (RESAMPLES, count)."""
    drawn = np.random.default_rng(seed).integers(count, size=(RESAMPLES, count))
    return np.array([np.bincount(row, minlength=count) for row in drawn])


def object_mean(values: NDArray[np.generic], object_id: NDArray[np.str_]) -> Estimate:
    """Return the mean of episodes' values (K,), with an interval over resampled objects.

    Args:
        values: Numbers or booleans, at least one.
        object_id: Object of each episode, (K,).
    """
    numbers = values.astype(np.float64)
    names, place = np.unique(object_id, return_inverse=True)
    sums = np.bincount(place, numbers, len(names))
    counts = np.bincount(place, minlength=len(names))
    times = object_resamples(len(names), seed=0)
    drawn = (times @ sums) / (times @ counts)
    return interval(float(numbers.mean()), drawn, float(numbers.min()), float(numbers.max()))


def interval(
    value: float, drawn: Array, lowest: float = -np.inf, highest: float = np.inf
) -> Estimate:
    """Return an estimate whose interval excludes the same share of draws (R,) on each side.

    The draws are shifted so that their mean is the value: resamples repeat episodes, which
    increases the calibration error. The interval is clipped to the figure's range.
    """
    if not len(drawn):
        return Estimate(value=float(value), low=float("nan"), high=float("nan"))
    tail = (1.0 - LEVEL) / 2.0
    ends = np.quantile(drawn - drawn.mean() + value, [tail, 1.0 - tail])
    low, high = np.clip(ends, lowest, highest)
    return Estimate(value=float(value), low=float(low), high=float(high))
