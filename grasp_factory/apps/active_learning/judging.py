"""Scores of a round's networks on held-out objects, and their mistakes on their own grasps."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from grasp_factory.apps.learning.examples import Examples
from grasp_factory.apps.learning.progress_callback import ProgressWatch, unwatched
from grasp_factory.apps.learning.scores import (
    FIGURES,
    RANGE,
    Bootstrap,
    Estimate,
    interval,
    object_mean,
)
from grasp_factory.core.geometry import Array
from grasp_factory.dataset.dataset import Dataset
from grasp_factory.policies.networks import GraspModel

SURE = 0.9
"""A model is sure of an outcome if it predicts it with this probability or more."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Judgement:
    """Figures of a round's networks, over all episodes and over resamples."""

    whole: Mapping[str, float]
    """Mean over the networks, by figure."""
    drawn: Mapping[str, Array]
    """(R,) by figure; each resample draws objects and networks."""

    def scores(self) -> dict[str, Estimate]:
        """Return each figure with its interval."""
        return {name: interval(self.whole[name], self.drawn[name], *RANGE) for name in self.whole}

    def gains(self, over: Judgement) -> dict[str, Estimate]:
        """Return by how much each figure exceeds another judgement's, resample by resample."""
        return {
            name: interval(self.whole[name] - over.whole[name], self.drawn[name] - over.drawn[name])
            for name in self.whole
        }


class Judge:
    """Judges networks on the same episodes and the same resamples."""

    def __init__(self, held_out: Examples) -> None:
        """Draw the resamples.

        Args:
            held_out: Examples of both labels.
        """
        self._held_out = held_out
        self._bootstrap = Bootstrap(held_out.success, held_out.object_id, seed=0)

    def judge(self, models: Sequence[GraspModel], watch: ProgressWatch = unwatched) -> Judgement:
        """Return the figures of a round's networks.

        Networks at the same position in two rounds have the same training seed, and resamples draw
        the same positions in both rounds, so that gains are paired.
        """
        answers = [model.predict(self._held_out.inputs) for model in models]
        whole, drawn = {}, {}
        with watch("judging", len(FIGURES)) as step:
            for name, figure in FIGURES.items():
                whole[name], drawn[name] = self._bootstrap.over_networks(figure, answers)
                step()
        return Judgement(whole=whole, drawn=drawn)


@dataclass(frozen=True, slots=True, kw_only=True)
class Mistakes:
    """A model's probabilities, compared with the outcomes of the grasps that it chose."""

    episodes: int
    """Number of episodes that the model judged."""
    expected: float
    """Mean predicted probability that a grasp holds."""
    success: Estimate
    """Share of the grasps that held."""
    wrong: Estimate
    """Share of the grasps with the less probable outcome."""
    surprise: Estimate
    """Mean cross-entropy, nats; a prediction of 0.5 has 0.69."""
    sure: int
    """Number of episodes of whose outcome the model was sure."""
    wrong_when_sure: Estimate | None
    """Share of these in which the model was wrong; None if there are none."""


def mistakes_of(dataset: Dataset) -> Mistakes | None:
    """Compare the scores of a store's executed grasps, which are log odds, with their outcomes.

    Returns:
        None if no episode has a grasp.
    """
    rows = dataset.committed
    rows = rows[np.isfinite(dataset.column("grasp_score")[rows])]
    if not len(rows):
        return None
    odds, success, objects = (
        dataset.column(name)[rows] for name in ("grasp_score", "success", "object_id")
    )
    holds = 1.0 / (1.0 + np.exp(-odds))
    wrong = (holds >= 0.5) != success
    sure = np.maximum(holds, 1.0 - holds) >= SURE
    return Mistakes(
        episodes=len(rows),
        expected=float(holds.mean()),
        success=object_mean(success, objects),
        wrong=object_mean(wrong, objects),
        surprise=object_mean(np.logaddexp(0.0, odds) - success * odds, objects),
        sure=int(sure.sum()),
        wrong_when_sure=object_mean(wrong[sure], objects[sure]) if sure.any() else None,
    )
