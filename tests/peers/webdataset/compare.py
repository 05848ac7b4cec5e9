"""Compares what webdataset reads with the store."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from grasp_factory.dataset.dataset import Dataset

FORMAT = "webdataset"
SETTINGS = {"episodes_per_shard": 4}
GENERATE = ("--camera", "front", "--camera", "wrist")


def compare(dataset: Dataset, export: Path, read: Mapping[str, NDArray[Any]]) -> int:
    """Compare every array; "rgb8" yields three channels for images of one channel, too."""
    seen = 0
    for place, episode in enumerate(dataset):
        assert int(read[f"{place}/cls"]) == episode.success
        assert str(read[f"{place}/outcome"]) == episode.outcome.name.lower()
        for path, values in episode.contents().items():
            if path.startswith("episodes/"):
                continue
            key = path.replace("cameras/", "camera_").replace("streams/", "stream_")
            key = key.replace("videos/", "video_").replace("/", "_").lower()
            if path.endswith(("/rgb", "/segmentation")) and path.startswith("cameras/"):
                for image, time in zip(values, ("before", "after"), strict=True):
                    found = read[f"{place}/{key}_{time}.png"]
                    is_rgb = image.ndim == 3
                    np.testing.assert_array_equal(found if is_rgb else found[..., 0], image)
            else:
                np.testing.assert_array_equal(read[f"{place}/{key}.npy"], values)
            seen += values.size
    return seen
