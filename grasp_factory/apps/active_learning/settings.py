"""The settings of a flywheel, and the config of every store that follows from them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from enum import IntEnum
from typing import Any

import numpy as np

from grasp_factory.apps.learning.training import TrainSettings
from grasp_factory.core.config.factory_config import FactoryConfig
from grasp_factory.core.serialization import check, check_range, normalise
from grasp_factory.core.splits import SPLITS
from grasp_factory.factory.run_request import MAX_EPISODES
from grasp_factory.policies import POLICIES

ARMS: Mapping[str, str] = {"active": "uncertain", "random": "random"}
"""By arm: what its policy ``learned`` prefers; both arms draw from the same candidates."""
SELECTIONS: Mapping[str, tuple[str, ...]] = {**{arm: (arm,) for arm in ARMS}, "both": tuple(ARMS)}
"""By value of ``--select``: the arms that run."""
LEARNED = "learned"
_ANY_MODEL = "0" * 64
"""Placeholder for the SHA-256 of a model that does not exist yet."""
LEARNING, HELD_OUT = ("train", "val"), ("test",)
"""Splits whose objects the rounds drop, and splits whose objects the evaluation drops."""


class _Purpose(IntEnum):
    """What a seed is derived for. The seeds depend on the values: append only."""

    ROUND = 0
    EVALUATION = 1
    TRAINING = 2


@dataclass(frozen=True, slots=True, kw_only=True)
class FlywheelSettings:
    """Everything that determines the content of a flywheel's folder."""

    config: FactoryConfig
    """Config of all stores, except for seeds, splits and, from round 1 on, the policy."""
    rounds: int = 3
    """Number of rounds after round 0."""
    start: int = 500
    """Episodes of round 0, by the config's own policies."""
    budget: int = 500
    """Episodes of each later round of an arm."""
    evaluation: int = 1000
    """Held-out episodes, by the config's own policies."""
    select: str = "both"
    """The arms that run: active, random or both."""
    tries: int = 0
    """Held-out episodes in which each arm's last model chooses the grasps."""
    seeds: int = 3
    """Networks that each round trains, from different seeds; the first one chooses grasps."""
    epochs: int = 20
    """Largest number of training epochs."""

    def __post_init__(self) -> None:
        normalise(self)
        check_range(self, "rounds", 1, 100)
        for key in ("start", "budget", "evaluation"):
            check_range(self, key, 1, MAX_EPISODES)
        check_range(self, "tries", 0, MAX_EPISODES)
        check_range(self, "seeds", 1, 100)
        check_range(self, "epochs", 1, 10_000)
        check(self.select in SELECTIONS, "select", self.select, ", ".join(SELECTIONS))
        self._check_config()

    def _check_config(self) -> None:
        config = self.config
        valid = f"policies that need no model, for round 0; later rounds take {LEARNED} themselves"
        check(LEARNED not in config.policies, "policies", list(config.policies), valid)
        valid = f"{', '.join(SPLITS)}: a flywheel learns from some and is judged on the others"
        got = list(config.object_splits)
        check(config.object_splits == SPLITS, "object_splits", got, valid)
        for key in self._own.keys() & {"model", "prefer"}:
            valid = "nothing: each round of a flywheel sets it"
            check(False, f"policy_parameters.{LEARNED}.{key}", self._own[key], valid)

    @property
    def arms(self) -> tuple[str, ...]:
        """The arms that run."""
        return SELECTIONS[self.select]

    @property
    def start_config(self) -> FactoryConfig:
        """The config of round 0."""
        return self._of_base(self.round_seed(0), LEARNING)

    @property
    def evaluation_config(self) -> FactoryConfig:
        """The config of the held-out episodes."""
        return self._of_base(self._seed(_Purpose.EVALUATION), HELD_OUT)

    def round_config(self, number: int, arm: str, sha256: str) -> FactoryConfig:
        """Return the config of a later round; arms differ in the model and in what it prefers.

        Args:
            number: Number of the round, from 1.
            arm: One of ``ARMS``.
            sha256: SHA-256 of the previous round's model.
        """
        return self._of_model(sha256, ARMS[arm], self.round_seed(number), LEARNING)

    def tries_config(self, sha256: str) -> FactoryConfig:
        """Return the config of a model's own grasps, in the scenes of the held-out episodes."""
        return self._of_model(sha256, "best", self._seed(_Purpose.EVALUATION), HELD_OUT)

    def round_seed(self, number: int) -> int:
        """Return the seed of a round. It is the same for both arms, so they see the same scenes."""
        return self._seed(_Purpose.ROUND, number)

    def training(self, number: int) -> TrainSettings:
        """Return the training settings of a network, by its number from 0."""
        return TrainSettings(seed=self._seed(_Purpose.TRAINING, number), epochs=self.epochs)

    def check_learned(self) -> None:
        """Check the settings of the policy ``learned`` that the config has.

        Raises:
            ConfigError: naming the invalid setting.
        """
        POLICIES[LEARNED].settings({**self._own, "model": _ANY_MODEL})

    @property
    def _own(self) -> Mapping[str, Any]:
        return self.config.policy_parameters.get(LEARNED, {})

    def _of_base(self, seed: int, splits: tuple[str, ...]) -> FactoryConfig:
        others = {k: v for k, v in self.config.policy_parameters.items() if k != LEARNED}
        return replace(self.config, seed=seed, object_splits=splits, policy_parameters=others)

    def _of_model(
        self, sha256: str, prefer: str, seed: int, splits: tuple[str, ...]
    ) -> FactoryConfig:
        own = {**self._own, "model": sha256, "prefer": prefer}
        return replace(
            self.config,
            seed=seed,
            object_splits=splits,
            policies={LEARNED: 1.0},
            policy_parameters={**self.config.policy_parameters, LEARNED: own},
        )

    def _seed(self, *key: int) -> int:
        sequence = np.random.SeedSequence(self.config.seed, spawn_key=tuple(map(int, key)))
        return int(sequence.generate_state(1, np.uint64)[0] >> np.uint64(1))
