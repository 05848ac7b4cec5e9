"""Draw objects of some splits only, such as those for training or those for testing."""

from __future__ import annotations

from collections.abc import Collection

import numpy as np

from grasp_factory.core.splits import SPLITS
from grasp_factory.errors import ConfigError, RecipeError
from grasp_factory.objects.base import FiniteSet, ObjectModel, ObjectSet

TRIES = 500
"""Maximum draws; a split with a tenth of the objects is missed with probability 1e-23."""


def check_splits(found: ObjectSet, splits: Collection[str]) -> None:
    """Check that a set has objects of some splits; a set that is not listed always passes.

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
    """Draw an object of some splits; with all splits it is the object that ``found.draw`` returns.

    Raises:
        RecipeError: if ``TRIES`` draws find no object of these splits.
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
