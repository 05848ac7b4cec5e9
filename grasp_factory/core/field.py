"""One array of the store, as a record: path, dimensions, type, unit, frame and meaning."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from grasp_factory.core.enums import Label, names

LABELS = tuple(names(Label))
"""``Field.names`` of label arrays; the fields of a store add a name for each further object."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Field:
    """One array of the store; its first dimension, N, is the episode."""

    path: str
    """Path of the array in the store; ``{camera}`` is replaced by each camera's name."""
    dims: tuple[str | int, ...]
    """Dimensions after N; ``schema.sizes`` returns the length of each lettered dimension."""
    dtype: str
    """Name of a numpy dtype such as ``float32``, or ``string``."""
    units: str = ""
    frame: str = ""
    description: str
    names: tuple[str, ...] = ()
    """For coded values: their names; the position of a name is its value."""
    empty: int = 0
    """Fill value of an integer array; not 0 where 0 is a valid value."""
    gaps: bool = False
    """Whether recorded values may be NaN, which means that there is no value."""
    is_real: bool = False
    """Whether only stores that may hold real episodes have it (``FactoryConfig.capture``)."""
    always: bool = False
    """Whether its values are also known of a real episode, of which most others may be NaN."""
    length_column: str = ""
    """For time series, which are padded: path of the column with the valid length; else empty."""

    @property
    def fill(self) -> Any:
        """Fill value: what the array holds where nothing was recorded."""
        if self.dtype == "string":
            return ""
        if self.dtype == "bool":
            return False
        return float("nan") if self.dtype.startswith("float") else self.empty

    def may_be_nan(self, *, is_real: bool) -> bool:
        """Return whether a recorded value may be NaN: of a real episode, what was not measured.

        Args:
            is_real: whether the row holds a real episode.
        """
        return not self.always if is_real else self.gaps

    @property
    def is_image(self) -> bool:
        """True for arrays with one frame per chunk."""
        return "H" in self.dims

    @property
    def is_video(self) -> bool:
        """True for images that are a time series; each episode is a separate file."""
        return self.is_image and bool(self.length_column)


def field(
    path: str, dims: tuple[str | int, ...], dtype: str, description: str, **more: Any
) -> Field:
    """Return a field; positional arguments keep a table of fields readable."""
    return Field(path=path, dims=dims, dtype=dtype, description=description, **more)
