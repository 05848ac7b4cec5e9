"""The different objects of an export, numbered from 1."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

from grasp_factory.core.episode import Episode, ObjectSpec
from grasp_factory.writers.exporters.base import ExportJob, ExportPart
from grasp_factory.writers.exporters.json_items import (
    item,
    joined_items,
    keep_items,
    write_items,
)
from grasp_factory.writers.exporters.selection import Selection

MODELS_FILE = "objects.json"
"""The list of all models: which object of which set a number means."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ModelKey:
    """What tells one shape from another."""

    object_set: str
    object_id: str
    folder_sha256: str
    scale: float


@dataclass(frozen=True, slots=True, kw_only=True)
class NumberedModel:
    """The number of a model, and the first episode that has it."""

    number: int
    """From 1, in the order of first use."""
    first: int
    """Number of that episode in the export; its part writes the model's files."""


ModelNumbers = Mapping[ModelKey, NumberedModel]


def key_of(recipe: ObjectSpec) -> ModelKey:
    """Return what tells an object of a recipe from others; its mass and appearance do not."""
    return ModelKey(
        object_set=recipe.object_set,
        object_id=recipe.object_id,
        folder_sha256=recipe.folder_sha256,
        scale=recipe.scale,
    )


def number_models(episodes: Selection) -> dict[ModelKey, NumberedModel]:
    """Return all models of the episodes, in the order of first use."""
    numbers: dict[ModelKey, NumberedModel] = {}
    for place, spec in enumerate(episodes.specs()):
        for recipe in spec.objects:
            model = NumberedModel(number=len(numbers) + 1, first=place)
            numbers.setdefault(key_of(recipe), model)
    return numbers


def new_models(
    numbers: ModelNumbers, place: int, episode: Episode
) -> Iterator[tuple[int, ObjectSpec]]:
    """Yield the number and a recipe of each model that an episode is the first to have."""
    for key, recipe in {key_of(recipe): recipe for recipe in episode.spec.objects}.items():
        if numbers[key].first == place:
            yield numbers[key].number, recipe


def keep_model_rows(
    job: ExportJob, part: ExportPart, models: Mapping[int, tuple[ObjectSpec, str]]
) -> None:
    """Keep the rows of ``MODELS_FILE`` for a part's new models: recipe and file by number."""
    rows = (
        {
            "number": number,
            "object_set": recipe.object_set,
            "object_id": recipe.object_id,
            "family": recipe.family,
            "split": recipe.split,
            "folder_sha256": recipe.folder_sha256,
            "scale": recipe.scale,
            "file": file,
        }
        for number, (recipe, file) in models.items()
    )
    keep_items(job, part, MODELS_FILE, map(item, rows))


def write_model_rows(job: ExportJob) -> None:
    """Write ``MODELS_FILE``."""
    write_items(job.folder / MODELS_FILE, "[", joined_items(job, MODELS_FILE), "]")
