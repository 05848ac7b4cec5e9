"""An episode's columns as plain data for JSON."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from grasp_factory.core.enums import label_names, word_of
from grasp_factory.core.episode import EpisodeSpec
from grasp_factory.core.field import LABELS
from grasp_factory.core.schema import FIELDS
from grasp_factory.core.serialization import to_plain
from grasp_factory.writers.exporters.json_file import finite

_CODED = {row.path: row.names for row in FIELDS if row.names}


def plain_columns(spec: EpisodeSpec, contents: Mapping[str, NDArray[Any]]) -> dict[str, Any]:
    """Return an episode's columns by name as scalars, lists and, for the recipe, a dict.

    A coded value is its word. NaN, and a coded value that was not measured, are None. The other
    values are those of the store.

    Args:
        spec: the recipe.
        contents: what ``Episode.contents`` returns.
    """
    labels = label_names(len(spec.objects))
    columns: dict[str, Any] = {}
    for path, values in contents.items():
        if path.startswith("episodes/"):
            words = labels if _CODED.get(path) == LABELS else _CODED.get(path)
            value = word_of(int(values), words) if words else plain(values)
            columns[path.removeprefix("episodes/")] = value
    return columns | {"spec": to_plain(spec)}


def plain(values: NDArray[Any]) -> Any:
    """Return an array as lists and scalars; NaN and infinite numbers are None."""
    listed = values.tolist()
    is_finite = values.dtype.kind != "f" or np.isfinite(values).all()
    return listed if is_finite else finite(listed)
