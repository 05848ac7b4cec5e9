"""What is remembered of a round: its grasps, who chose them, its networks and their figures."""

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
    """How a model chose the grasps of a round, and how right it was about them."""

    model_sha256: str
    prefer: str
    """What the policy ``learned`` put first."""
    mistakes: Mistakes | None
    """None if no episode has a grasp."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ModelFacts:
    """A trained network."""

    path: str
    """In the flywheel's folder."""
    sha256: str
    settings: Mapping[str, Any]
    """How it was trained."""
    versions: Mapping[str, str]
    """Of what trained it."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Round:
    """What a round did and what came of it."""

    round: int
    store: StoreFacts
    choice: Choice | None
    """None in round 0, whose grasps the config's own policies chose."""
    learned_from: tuple[str, ...]
    """Paths of stores, this round's last."""
    episodes: int
    """In all of them."""
    train_examples: int
    val_examples: int
    models: tuple[ModelFacts, ...]
    scores: Mapping[str, Estimate]
    """Of the networks on held-out objects, by figure."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SelectionGain:
    """By how much the active arm's figures exceed the random arm's after a round."""

    round: int
    episodes: int
    """That each arm has learned from."""
    scores: Mapping[str, Estimate]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ArmState:
    """Where an arm stands after a round."""

    parts: tuple[TrainingSet, ...]
    """Of each round; arms share the first."""
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
