"""Numbers that an episode must not have: infinity anywhere, NaN where it has no meaning."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from grasp_factory.core.schema import Field


def non_finite(contents: Mapping[str, NDArray[Any]], fields: Iterable[Field]) -> str:
    """Return the first array with a number that is neither finite nor a gap; empty for none.

    Args:
        contents: An episode's arrays by path, unpadded.
        fields: Those of the store; ``Field.gaps`` says where NaN is a gap.
    """
    with_gaps = {field.path for field in fields if field.gaps}
    for path, values in contents.items():
        if values.dtype.kind != "f" or np.isfinite(values).all():
            continue
        if path not in with_gaps or np.isinf(values).any():
            return path
    return ""
