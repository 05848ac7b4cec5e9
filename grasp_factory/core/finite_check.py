"""A check for invalid numbers in an episode: infinity, and NaN where it has no meaning."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from grasp_factory.core.real_columns import is_real
from grasp_factory.core.schema import Field


def non_finite(contents: Mapping[str, NDArray[Any]], fields: Iterable[Field]) -> str:
    """Return the path of the first array with a number that is neither finite nor a gap.

    The result is empty if there is no such array.

    Args:
        contents: An episode's arrays by path, unpadded.
        fields: The fields of the store, which say where NaN means a gap: in a real episode also
            what was not measured.
    """
    real = is_real(contents)
    with_gaps = {field.path for field in fields if field.may_be_nan(is_real=real)}
    for path, values in contents.items():
        if values.dtype.kind != "f" or np.isfinite(values).all():
            continue
        if path not in with_gaps or np.isinf(values).any():
            return path
    return ""
