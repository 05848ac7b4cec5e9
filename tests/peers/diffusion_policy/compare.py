"""Compares what Diffusion Policy reads with the store."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from grasp_factory.dataset.dataset import Dataset
from grasp_factory.writers.exporters.diffusion_policy import BufferNames, step_arrays
from grasp_factory.writers.exporters.steps import steps_of

FORMAT = "diffusion_policy"
SETTINGS: dict[str, Any] = {}
GENERATE = ("--camera", "front", "--camera", "wrist")


def compare(dataset: Dataset, export: Path, read: Mapping[str, NDArray[Any]]) -> int:
    """Compare every step and the one after it."""
    seen = 0
    lines = (export / "grasp_factory_episodes.jsonl").read_text().splitlines()
    lengths = np.diff(read["meta/episode_ends"], prepend=0)
    for line, length in zip(map(json.loads, lines), lengths, strict=True):
        place, episode = line["episode"], dataset[line["row"]]
        steps = steps_of(episode)
        assert length == len(steps.record)
        expected = step_arrays(episode, steps, BufferNames.DIFFUSION_POLICY)
        for number, frames in enumerate(steps.images.values()):
            expected[f"camera{number}_rgb"] = frames
        names = {key.split("/")[1] for key in read if key.startswith(f"{place}/")}
        assert names == set(expected)
        for name, values in expected.items():
            after = np.concatenate([values[1:], values[-1:]])
            np.testing.assert_array_equal(read[f"{place}/{name}"], values, strict=True)
            np.testing.assert_array_equal(read[f"{place}/{name}/next"], after, strict=True)
            seen += 2 * values.size
        assert ("train", "val", "test")[read["meta/episode_split"][place]] == str(
            episode.columns["split"]
        )
        assert read["meta/episode_success"][place] == episode.success
    return seen
