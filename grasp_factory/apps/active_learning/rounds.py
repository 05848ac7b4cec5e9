"""Records of a round: its grasps, the model that chose them, its networks and their figures."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from grasp_factory.apps.active_learning.judging import Judgement, Mistakes
from grasp_factory.apps.active_learning.learning import TrainingSet
from grasp_factory.apps.active_learning.stores import StoreFacts
from grasp_factory.apps.learning.scores import Estimate
from grasp_factory.policies.networks import GraspModel


@dataclass(frozen=True, slots=True, kw_only=True)
class Choice:
    """How a model chose the grasps of a round, and how well it predicted their outcomes."""

    model_sha256: str
    prefer: str
    """Which grasps the policy ``learned`` preferred."""
    mistakes: Mistakes | None
    """None if no episode has a grasp."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ModelFacts:
    """A trained network."""

    path: str
    """Relative to the flywheel's folder."""
    sha256: str
    settings: Mapping[str, Any]
    """How it was trained."""
    versions: Mapping[str, str]
    """Versions of the software that trained it."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Round:
    """What a round did, and its results."""

    round: int
    store: StoreFacts
    choice: Choice | None
    """None in round 0, whose grasps the config's own policies chose."""
    learned_from: tuple[str, ...]
    """Paths of the stores; this round's store is the last."""
    episodes: int
    """Number of episodes in all these stores."""
    train_examples: int
    val_examples: int
    models: tuple[ModelFacts, ...]
    scores: Mapping[str, Estimate]
    """Scores of the networks on held-out objects, by figure."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SelectionGain:
    """By how much the active arm's figures exceed the random arm's after a round."""

    round: int
    episodes: int
    """Number of episodes that each arm has learned from."""
    scores: Mapping[str, Estimate]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ArmState:
    """The state of an arm after a round."""

    parts: tuple[TrainingSet, ...]
    """The training set of each round; arms share the first."""
    models: Sequence[GraspModel]
    judgement: Judgement
    turn: Round


def gains_of(active: Sequence[ArmState], random: Sequence[ArmState]) -> list[SelectionGain]:
    """Compare two arms after each round that both have made; they share round 0."""
    return [
        SelectionGain(
            round=a.turn.round,
            episodes=a.turn.episodes,
            scores=a.judgement.gains(r.judgement),
        )
        for a, r in list(zip(active, random, strict=False))[1:]
    ]
