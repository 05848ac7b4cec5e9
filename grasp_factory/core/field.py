"""One array of the store, as a record: path, dimensions, type, unit, frame and meaning."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from grasp_factory.core.enums import Label, names

LABELS = tuple(names(Label))
"""``Field.names`` of arrays of labels; the store's own fields name each further object, too."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Field:
    """One array of the store; its first dimension, N, is the episode."""

    path: str
    """``{camera}`` stands for each camera's name."""
    dims: tuple[str | int, ...]
    """Dimensions after N; ``schema.sizes`` has the length of each letter."""
    dtype: str
    """Name of a numpy dtype such as ``float32``, or ``string``."""
    units: str = ""
    frame: str = ""
    description: str
    names: tuple[str, ...] = ()
    """For coded values: the word whose position is the value."""
    empty: int = 0
    """Fill value of an integer array, where 0 would mean a word."""
    gaps: bool = False
    """Whether NaN is valid among the recorded values; it means that there is no value."""
    length_column: str = ""
    """For time series, which are padded: path of the column with the valid length; else empty."""

    @property
    def fill(self) -> Any:
        """What the array holds where nothing was recorded."""
        if self.dtype == "string":
            return ""
        if self.dtype == "bool":
            return False
        return float("nan") if self.dtype.startswith("float") else self.empty

    @property
    def is_image(self) -> bool:
        """True for arrays with one frame per chunk."""
        return "H" in self.dims

    @property
    def is_video(self) -> bool:
        """True for images that are a time series: each episode of them is a file of its own."""
        return self.is_image and bool(self.length_column)


def field(
    path: str, dims: tuple[str | int, ...], dtype: str, description: str, **more: Any
) -> Field:
    """Return a field; a table of them reads better without keywords."""
    return Field(path=path, dims=dims, dtype=dtype, description=description, **more)
