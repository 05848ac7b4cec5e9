"""Compares what robomimic reads with the store."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from grasp_factory.dataset.dataset import Dataset
from grasp_factory.writers.exporters.steps import observations, steps_of

FORMAT = "robomimic"
SETTINGS: dict[str, Any] = {}
GENERATE = ("--camera", "front", "--camera", "wrist")


def compare(dataset: Dataset, export: Path, read: Mapping[str, NDArray[Any]]) -> int:
    """Compare every step: observations now and after it, actions, rewards and ends."""
    seen = 0
    with h5py.File(export / "demo.hdf5") as file:
        scale, offset = (file["data"].attrs[f"action_{name}"] for name in ("scale", "offset"))
    lines = (export / "grasp_factory_episodes.jsonl").read_text().splitlines()
    for line in map(json.loads, lines):
        demo, episode = f"demo_{line['episode']}", dataset[line["row"]]
        steps = steps_of(episode)
        last = len(steps.record) - 1
        observed = observations(episode, steps)
        for k in range(last + 1):
            expected = {"actions_absolute": steps.action[k], "rewards": steps.reward[k]}
            expected |= {"dones": k == last, "actions": (steps.action[k] - offset) / scale}
            expected |= {f"obs/{name}": values[k] for name, values in observed.items()}
            after = min(k + 1, last)
            expected |= {f"next_obs/{name}": values[after] for name, values in observed.items()}
            for name, values in expected.items():
                found = read[f"{demo}/{k}/{name}"]
                if name == "actions":
                    np.testing.assert_allclose(found, values, atol=1e-7)
                else:
                    np.testing.assert_array_equal(found, values)
                seen += np.size(values)
        split = {"val": "valid"}.get(str(episode.columns["split"]), str(episode.columns["split"]))
        assert demo in read["mask/None"]
        for name in ("train", "valid", "test"):
            assert (demo in read[f"mask/{name}"]) == (name == split)
        assert (demo in read["mask/success"]) == episode.success
    return seen
