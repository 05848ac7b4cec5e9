"""An attempt in one picture: its curves on one time axis, its images, its touch."""

# ruff: noqa: PLC0415

from __future__ import annotations

import numpy as np

from grasp_factory.apps.pictures.painting import BgrImage
from grasp_factory.core.optional import require
from grasp_factory.dataset.dataset import Dataset
from grasp_factory.dataset.plausible import pad_size
from grasp_factory.errors import UsageError, lookup

SIZE = (1600, 1200)
"""Width and height of a picture, pixels; letters and lines are designed for this size."""
SMALLEST, LARGEST = 600, 8000
"""Minimum and maximum pixels of a side."""


def plot_episode(
    dataset: Dataset, index: int, camera: str | None = None, size: tuple[int, int] = SIZE
) -> BgrImage:
    """Return the picture of an episode, BGR, with width and height ``size``.

    Args:
        dataset: The dataset with the episode.
        index: Index of the episode.
        camera: The camera whose images are shown at the side; None for the first.
        size: Pixels; letters and lines scale with the side that has less room.

    Raises:
        UsageError: for an invalid index or size, or if matplotlib is not installed.
        UnknownNameError: for a camera that the store does not have.
        StoreError: for an episode that is missing or quarantined.
    """
    require("matplotlib", extra="plot")
    if not all(SMALLEST <= side <= LARGEST for side in size):
        shown = f"{size[0]}x{size[1]}"
        raise UsageError(f"size {shown}: valid: sides of {SMALLEST} to {LARGEST} pixels")
    if not 0 <= index < len(dataset):
        raise UsageError(f"episode {index}: {dataset.path} has episodes 0 to {len(dataset) - 1}")
    camera = next(iter(dataset.config.cameras)) if camera is None else camera
    lookup(dataset.config.cameras, "camera", camera)
    from grasp_factory.apps.pictures.plot.figure import Subject, figure_of, pixels_of

    subject = Subject(
        store=dataset.path.name,
        row=index,
        episode=dataset[index],
        camera=camera,
        pad_size=pad_size(dataset.attributes),
        maker=str(dataset.attributes.get("versions", {}).get("grasp_factory", "")),
    )
    return np.ascontiguousarray(pixels_of(figure_of(subject, size))[..., ::-1])
