"""Many episodes on one sheet: a small tile for each, before and after side by side."""

from __future__ import annotations

import math
from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from grasp_factory.apps.pictures import painting
from grasp_factory.apps.pictures.painting import BgrImage
from grasp_factory.apps.pictures.sheet import WORTH_TELLING, chosen
from grasp_factory.core import palette
from grasp_factory.core.enums import Outcome
from grasp_factory.core.shown_units import SHOWN_UNITS
from grasp_factory.core.thumbnail_size import thumbnail_height
from grasp_factory.dataset.dataset import Dataset
from grasp_factory.errors import UsageError, lookup
from grasp_factory.writers.zarr.writer import QUARANTINED

DEFAULT, MOST = 60, 600
"""Default and maximum number of episodes on a sheet."""
MOST_ACROSS = 50
PANEL, SEAM = 159, 2
"""Width of each of a tile's two images, and of the gap between them, pixels."""
WIDTH = 2 * PANEL + SEAM
CAPTION = 38
"""Height of the caption below them, pixels."""
GAP = 6
HEADER = 40
SHAPE = 4 / 3
"""Approximate ratio of a sheet's width to its height."""
TOGETHER = 32
"""Number of episodes whose images are read at once."""
LETTERS = 52
"""Maximum letters in a caption's second line, which is as wide as a tile."""


def tiles_of(
    dataset: Dataset,
    indices: Sequence[int] | None,
    camera: str,
    n: int | None = None,
    across: int | None = None,
) -> BgrImage:
    """Return a sheet of tiles, BGR, in the order of ``indices``.

    A quarantined episode has a tile without images that says why.

    Args:
        dataset: The dataset of the episodes.
        indices: Indices of the episodes; None for a selection of all.
        camera: The camera whose images are shown.
        n: Maximum number, chosen from these; None for all of them, or for ``DEFAULT`` if
            ``indices`` is None.
        across: Number of tiles side by side; None for a sheet that is slightly wider than high.

    Raises:
        UsageError: for an index that the store does not have, or for no or too many episodes.
        UnknownNameError: for a camera that the store does not have.
        StoreError: for an episode that is missing or damaged.
    """
    lookup(dataset.config.cameras, "camera", camera)
    if across is not None and not 1 <= across <= MOST_ACROSS:
        raise UsageError(f"{across} tiles side by side: valid: 1 to {MOST_ACROSS}")
    rows = chosen(dataset, indices, n, default=DEFAULT, most=MOST)
    if not rows:
        raise UsageError("there is no episode to draw")
    tiles: list[BgrImage] = []
    status = dataset.status
    for start in range(0, len(rows), TOGETHER):
        some = rows[start : start + TOGETHER]
        there = [row for row in some if status[row] != QUARANTINED]
        pictures = _pictures(dataset, there, camera)
        words = dict(zip(there, _captions(dataset, there), strict=True))
        for row in some:
            drawn = row in pictures
            tiles.append(_tile(pictures[row], words[row]) if drawn else _no_tile(dataset, row))
    height, width = tiles[0].shape[:2]
    columns = across or math.ceil(math.sqrt(len(tiles) * SHAPE * height / width))
    sheet = grid(tiles, min(columns, len(tiles)))
    head: BgrImage = np.full((HEADER, sheet.shape[1], 3), painting.PAPER, np.uint8)
    store, length = dataset.path.name, len(dataset)
    title = f"{store}: {len(rows)} of {length} episodes, before and after, camera {camera}"
    painting.put_text(head, title, (GAP, HEADER // 2 + 2), height=14)
    return np.vstack([head, sheet])


def grid(tiles: Sequence[BgrImage], columns: int) -> BgrImage:
    """Return one image with pictures of equal size in a grid, row by row."""
    height, width = tiles[0].shape[:2]
    rows = math.ceil(len(tiles) / columns)
    shape = (rows * (height + GAP) + GAP, columns * (width + GAP) + GAP, 3)
    image: BgrImage = np.full(shape, painting.PAPER, np.uint8)
    for i, tile in enumerate(tiles):
        top, left = (GAP + step * (side + GAP) for step, side in
                     zip(divmod(i, columns), (height, width), strict=True))  # fmt: skip
        image[top : top + height, left : left + width] = tile
    return image


def _pictures(dataset: Dataset, rows: Sequence[int], camera: str) -> dict[int, BgrImage]:
    """Return before and after of each row, side by side, BGR."""
    before, after = (dataset.images(rows, camera, "rgb", frame) for frame in (0, 1))
    pictures = {}
    for k, row in enumerate(rows):
        left, right = _small(before[k]), _small(after[k])
        seam: BgrImage = np.full((len(left), SEAM, 3), painting.PAPER, np.uint8)
        pictures[row] = np.hstack([left, seam, right])
    return pictures


def _captions(dataset: Dataset, rows: Sequence[int]) -> list[tuple[Outcome, str, str]]:
    """Return outcome, figures and target of each row."""
    out = []
    for row in rows:
        policy, lift, target = (
            dataset.value(row, name) for name in ("policy", "lift_height", "object_id")
        )
        words = [f"#{row}", str(policy)]
        if lift > WORTH_TELLING:  # false for NaN
            words.append(SHOWN_UNITS["lift_height"].text(lift))
        out.append((Outcome(int(dataset.value(row, "outcome"))), "  ".join(words), str(target)))
    return out


def _tile(picture: BgrImage, words: tuple[Outcome, str, str]) -> BgrImage:
    outcome, figures, target = words
    color = painting.outcome_color(outcome)
    return np.vstack([picture, _strip(color, _word(outcome.name), figures, target)])


def _no_tile(dataset: Dataset, row: int) -> BgrImage:
    """Return the tile of a quarantined row."""
    width, height = dataset.config.resolution
    size = (_height(width, height), WIDTH, 3)
    reason = str(dataset.column("error")[row])
    empty: BgrImage = np.full(size, painting.NOTHING, np.uint8)
    return np.vstack(
        [empty, _strip(painting.bgr(palette.QUARANTINED.light), "quarantined", f"#{row}", reason)]
    )


def _strip(color: painting.BgrColor, word: str, figures: str, below: str) -> BgrImage:
    strip: BgrImage = np.full((CAPTION, WIDTH, 3), painting.PAPER, np.uint8)
    cv2.rectangle(strip, (0, 0), (WIDTH, 2), color, cv2.FILLED)
    x = painting.put_text(strip, word, (2, 13), color, 11)
    painting.put_text(strip, figures, (x + 10, 13), painting.INK, 11)
    shown = below if len(below) <= LETTERS else f"{below[: LETTERS - 3]}..."
    painting.put_text(strip, shown, (2, 29), painting.PALE, 10)
    return strip


def _small(rgb: NDArray[np.uint8]) -> BgrImage:
    size = (PANEL, _height(rgb.shape[1], rgb.shape[0]))
    how = cv2.INTER_AREA if rgb.shape[1] >= PANEL else cv2.INTER_CUBIC
    image = cv2.resize(np.ascontiguousarray(rgb[..., ::-1]), size, interpolation=how)
    return np.asarray(image, np.uint8)


def _height(width: int, height: int) -> int:
    return max(16, thumbnail_height(PANEL, (height, width)))


def _word(name: str) -> str:
    return name.lower().replace("_", " ")
