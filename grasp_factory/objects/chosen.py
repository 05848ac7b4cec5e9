"""Objects of some splits only: those of training, or those that no training has seen."""

from __future__ import annotations

from collections.abc import Collection

import numpy as np

from grasp_factory.core.splits import SPLITS
from grasp_factory.errors import ConfigError, RecipeError
from grasp_factory.objects.base import FiniteSet, ObjectModel, ObjectSet

TRIES = 500
"""Draws for an object of a split: those that hold a tenth are missed once in 10 to the 23."""


def check_splits(found: ObjectSet, splits: Collection[str]) -> None:
    """Check that a set has objects of some splits, as far as it lists what it has.

    Raises:
        ConfigError: naming the set and the splits that it has.
    """
    if isinstance(found, FiniteSet) and not _of(found, splits):
        there = {model.split for model in found.models.values()}
        has = ", ".join(split for split in SPLITS if split in there)
        raise ConfigError(
            f"object_splits: got {', '.join(splits)}, of which object set {found.name!r} has no"
            f" object; valid with it: {has}; or leave the set out"
        )


def draw_of(found: ObjectSet, splits: Collection[str], rng: np.random.Generator) -> ObjectModel:
    """Draw an object of some splits; of all of them it is the one that the set itself draws.

    Raises:
        RecipeError: if the set does not seem to have any.
    """
    if set(splits) == set(SPLITS):
        return found.draw(rng)
    if isinstance(found, FiniteSet):
        models = _of(found, splits)
        return models[int(rng.integers(len(models)))]
    for _ in range(TRIES):
        model = found.draw(rng)
        if model.split in splits:
            return model
    words = " or ".join(splits)
    raise RecipeError(f"none of {TRIES} objects drawn from set {found.name!r} is of {words}")


def _of(found: FiniteSet, splits: Collection[str]) -> list[ObjectModel]:
    return [model for model in found.models.values() if model.split in splits]
