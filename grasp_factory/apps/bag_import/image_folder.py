"""A folder of PNG files that are numbered in the order of their stamps."""

from __future__ import annotations

from array import array
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from grasp_factory.writers.exporters.images import write_png


class ImageFolder:
    """Images are numbered as they come, and renamed at the end if their stamps did not ascend."""

    def __init__(self, folder: Path) -> None:
        """Create the folder.

        Raises:
            OSError: if it cannot be written, as in all methods.
        """
        folder.mkdir()
        self._folder = folder
        self._stamps = array("q")

    def add(self, stamp_ns: int, image: NDArray[Any]) -> None:
        """Write an image."""
        write_png(self._folder / _name(len(self._stamps)), image)
        self._stamps.append(stamp_ns)

    def finish(self) -> NDArray[np.int64]:
        """Return the stamps in the order of the images' numbers, ns."""
        stamps = np.array(self._stamps, np.int64)
        order = np.argsort(stamps, kind="stable")
        moved = [(int(old), new) for new, old in enumerate(order) if old != new]
        for old, _ in moved:
            (self._folder / _name(old)).rename(self._folder / f"old-{_name(old)}")
        for old, new in moved:
            (self._folder / f"old-{_name(old)}").rename(self._folder / _name(new))
        return stamps[order]

    def path(self, number: int) -> str:
        """Return an image's path below the folder's parent."""
        return f"{self._folder.name}/{_name(number)}"


def _name(number: int) -> str:
    return f"{number:06d}.png"
