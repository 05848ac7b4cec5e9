"""Compares what LeRobot's loader reads with the store."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from support.lossy_video import assert_same_video

from grasp_factory.dataset.dataset import Dataset

FORMAT = "lerobot"
SETTINGS: Mapping[str, Any] = {"episodes_per_file": 2}
GENERATE = ("--camera", "front", "--camera", "wrist")


def compare(dataset: Dataset, export: Path, read: Mapping[str, NDArray[Any]]) -> int:
    """Compare every array; LeRobot's items are float32, so its table is compared as well."""
    arrays = json.loads((export / "meta/arrays.json").read_text())
    rows = [int(row) for row in dataset.committed if dataset.value(row, "n_video")]
    seen = 0
    for k, row in enumerate(rows):
        episode, frames = dataset[row], int(dataset.value(row, "n_video"))
        assert bool(read[f"{k}/success"]) == episode.success
        family = episode.columns["object_family"]
        assert set(read[f"{k}/task"]) == {f"Grasp the {family.replace('_', ' ')} and lift it."}
        for path, values in episode.contents().items():
            feature = arrays.get(path, {}).get("feature")
            if feature is None:
                continue
            found = read[f"{k}/{feature}"]
            if path.endswith("/rgb"):
                seen += compare_images(found, values, is_exact="image" in SETTINGS.values())
                continue
            window = values[: frames * arrays[path]["records_per_frame"]]
            exact = read[f"{k}/exact/{feature}"]
            np.testing.assert_array_equal(exact.reshape(window.shape), window)
            np.testing.assert_array_equal(
                found.reshape(window.shape), window.astype(found.dtype, copy=False)
            )
            seen += window.size
    actions = read[f"{len(rows) - 1}/action"]
    following = np.append(np.arange(1, len(actions)), len(actions) - 1)
    np.testing.assert_array_equal(read["pairs"], np.stack([actions, actions[following]], axis=1))
    states = np.concatenate([read[f"{k}/observation.state"] for k in range(len(rows))])
    np.testing.assert_array_equal(read["batched"], states)
    for key in ("mean", "std", "min", "max"):
        wanted = getattr(states.astype(float), key)(axis=0)
        np.testing.assert_allclose(read[f"stats/observation.state/{key}"], wanted, rtol=1e-9)
    assert read["fps"] == dataset.config.video_hz
    return seen


def compare_images(found: NDArray[Any], wanted: NDArray[Any], *, is_exact: bool) -> int:
    """Compare images (frames, 3, H, W), 0 to 1, with RGB images; return the number that match."""
    images = found.transpose(0, 2, 3, 1) * 255.0
    if not is_exact:
        assert_same_video(images, wanted)
        return 0
    np.testing.assert_array_equal(np.rint(images), wanted)
    return wanted.size
