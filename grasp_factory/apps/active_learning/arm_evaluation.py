"""Success rates of grasps: those that each arm's last model chooses, and the config's policies'."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from grasp_factory.apps.active_learning.stores import StoreFacts
from grasp_factory.apps.learning.scores import Estimate, object_mean
from grasp_factory.dataset.dataset import Dataset


@dataclass(frozen=True, slots=True, kw_only=True)
class Tried:
    """The results of an arm's last model."""

    model_sha256: str
    store: StoreFacts
    success: Estimate
    """Share of the episodes that are a success."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ArmEvaluation:
    """Success rates in the same held-out scenes."""

    arms: Mapping[str, Tried]
    gain: Estimate | None
    """Gain of the active arm over the random one, scene by scene; None if there is only one arm."""
    policies: Mapping[str, Estimate]
    """Success rates of the config's own policies, in all held-out episodes."""


def success_of(dataset: Dataset) -> Estimate:
    """Return the share of a store's episodes that are a success."""
    rows = dataset.committed
    return object_mean(dataset.column("success")[rows], dataset.column("object_id")[rows])


def success_by_policy(dataset: Dataset) -> dict[str, Estimate]:
    """Return the share of successes for each policy."""
    rows = dataset.committed
    success, policy, objects = (
        dataset.column(name)[rows] for name in ("success", "policy", "object_id")
    )
    names = sorted(set(policy.tolist()))
    return {name: object_mean(success[policy == name], objects[policy == name]) for name in names}


def success_gain(active: Dataset, random: Dataset) -> Estimate:
    """Return the gain in the share of successes, over the scenes that both stores have."""
    rows = np.intersect1d(active.committed, random.committed)
    more = active.column("success")[rows].astype(float) - random.column("success")[rows]
    return object_mean(more, active.column("object_id")[rows])
