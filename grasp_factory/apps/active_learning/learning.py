"""The training set of a round, and its networks: trained, or read from their files."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np

from grasp_factory import __version__
from grasp_factory.apps.active_learning.files import read, write_if_new
from grasp_factory.apps.active_learning.stores import StoreFacts
from grasp_factory.apps.learning.examples import ExampleReader, Examples, Grasps
from grasp_factory.apps.learning.progress_callback import ProgressWatch
from grasp_factory.apps.learning.training import TrainSettings, fit
from grasp_factory.core.config.config_difference import first_difference
from grasp_factory.core.serialization import to_plain
from grasp_factory.dataset.dataset import Dataset
from grasp_factory.errors import UsageError
from grasp_factory.policies.networks import KINDS, GraspModel, TouchWindow, load_model, save_model
from grasp_factory.signals.grasp_crop import CropShape

KIND = "vision"
"""Kind of all networks of a flywheel: the policy ``learned`` ranks grasps before any contact."""
VERSIONS = "versions"
"""Key in a model's facts: versions of the software that trained it, not its training data."""

_LARGER = "begin another folder with a larger --eval"


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class TrainingSet:
    """Examples to learn from, and their stores."""

    stores: tuple[StoreFacts, ...]
    train: Examples
    val: Examples


def together(parts: Sequence[TrainingSet]) -> TrainingSet:
    """Return the training sets of several rounds as one, in their order."""
    return TrainingSet(
        stores=tuple(store for part in parts for store in part.stores),
        train=joined([part.train for part in parts]),
        val=joined([part.val for part in parts]),
    )


def training_set_of(dataset: Dataset, facts: StoreFacts, watch: ProgressWatch) -> TrainingSet:
    """Read the examples of a round's store.

    Raises:
        UsageError: if it has no episode with a grasp.
    """
    reader = _reader(dataset)
    rows = reader.usable()
    split = dataset.column("split")[rows]
    with watch("reading", len(rows)) as step:
        train, val = (reader.read(rows[split == name], step) for name in ("train", "val"))
    return TrainingSet(stores=(facts,), train=train, val=val)


def held_out_examples(dataset: Dataset, watch: ProgressWatch) -> Examples:
    """Read the examples that networks are judged on.

    Raises:
        UsageError: if no episode has a grasp, or if all of them have the same label.
    """
    reader = _reader(dataset)
    try:
        rows = reader.usable()
    except UsageError as error:
        raise UsageError(f"{error}; {_LARGER}") from None
    with watch("reading", len(rows)) as step:
        examples = reader.read(rows, step)
    good = int(examples.success.sum())
    if not 0 < good < len(examples):
        raise UsageError(
            f"evaluation: {good} of {len(examples)} usable episodes are a success; valid: some of"
            f" both kinds; {_LARGER}"
        )
    return examples


def joined(parts: Sequence[Examples]) -> Examples:
    """Concatenate the examples of several stores; ``rows`` are the row numbers in each store."""
    inputs = {name: np.concatenate([p.inputs[name] for p in parts]) for name in parts[0].inputs}
    others = {
        field.name: np.concatenate([getattr(part, field.name) for part in parts])
        for field in dataclasses.fields(Grasps)
    }
    return Examples(inputs=inputs, **others)


def learn(
    file: Path, training_set: TrainingSet, settings: TrainSettings, watch: ProgressWatch
) -> GraspModel:
    """Return the network in a file; train and write it if the file does not exist.

    Raises:
        UsageError: if the file has another network, or there is too little data to learn from.
    """
    facts = _facts(training_set, settings)
    data = read(file)
    if data is None:
        try:
            trained = fit(
                KIND, training_set.train, training_set.val, settings,
                crop=CropShape(), touch=TouchWindow(), facts=facts, watch=watch,
            )  # fmt: skip
        except UsageError as error:
            raise UsageError(f"{error}: begin another folder with a larger --start") from None
        data = save_model(trained.model)
        write_if_new(file, data)
    try:
        model = load_model(data, KIND)
    except UsageError as error:
        raise UsageError(f"{file}: {error}; move it away and run the same command again") from None
    different = first_difference(_lasting(model.facts), _lasting(facts))
    if different:
        raise UsageError(
            f"{file} was trained on something else ({different}); move it away and run the same"
            " command again, or choose another folder"
        )
    return model


def _reader(dataset: Dataset) -> ExampleReader:
    return ExampleReader(dataset=dataset, uses=KINDS[KIND])


def _facts(training_set: TrainingSet, settings: TrainSettings) -> dict[str, Any]:
    return {
        "stores": {store.path: to_plain(store) for store in training_set.stores},
        "train_examples": len(training_set.train),
        "val_examples": len(training_set.val),
        "settings": to_plain(settings),
        VERSIONS: {"grasp_factory": __version__, "torch": version("torch")},
    }


def _lasting(facts: Mapping[str, Any]) -> Any:
    """Return the facts that must match before a network is reused, as JSON represents them."""
    return json.loads(json.dumps({k: v for k, v in facts.items() if k != VERSIONS}))
