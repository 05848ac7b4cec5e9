"""Compares what TensorFlow Datasets reads with the store."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from grasp_factory.dataset.dataset import Dataset
from grasp_factory.writers.exporters.steps import observations, steps_of

FORMAT = "tfrecord"
SETTINGS = {"episodes_per_shard": 2}
GENERATE = ("--camera", "front", "--camera", "wrist")


def compare(dataset: Dataset, export: Path, read: Mapping[str, NDArray[Any]]) -> int:
    """Compare every array of the store and every step, with their types."""
    seen = 0
    lines = (export / "grasp_factory_episodes.jsonl").read_text().splitlines()
    for line in map(json.loads, lines):
        place, episode = line["episode"], dataset[line["row"]]
        steps = steps_of(episode)
        last = np.arange(len(steps.record)) == len(steps.record) - 1
        expected: dict[str, NDArray[Any]] = {
            f"episode_metadata/{path}": values
            for path, values in episode.contents().items()
            if not path.startswith("videos/")
        }
        expected |= {
            f"steps/observation/{name}": values
            for name, values in observations(episode, steps).items()
        }
        expected |= {
            "steps/observation/state": steps.state,
            "steps/action": steps.action,
            "steps/reward": steps.reward,
            "steps/is_first": np.arange(len(last)) == 0,
            "steps/is_last": last,
            "steps/is_terminal": last,
            "steps/discount": np.ones(len(last), np.float32),
        }
        text = read[f"{place}/steps/language_instruction"]
        assert str(text[0]).startswith("Grasp the ")
        names = {name for name in read if name.startswith(f"{place}/")}
        more = ("split", "episode_metadata/episode", "steps/language_instruction")
        assert names == {f"{place}/{name}" for name in (*expected, *more)}
        for name, values in expected.items():
            found = read[f"{place}/{name}"]
            assert found.dtype.kind == values.dtype.kind
            assert found.dtype.itemsize == values.dtype.itemsize or values.dtype.kind == "U"
            np.testing.assert_array_equal(found, values)
            seen += values.size
        assert str(read[f"{place}/split"]) == str(episode.columns["split"])
    return seen
