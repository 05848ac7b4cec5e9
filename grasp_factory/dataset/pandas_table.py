"""The columns of a dataset as a table of pandas."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from grasp_factory.core.field import Field
from grasp_factory.core.optional import require
from grasp_factory.core.schema import NOT_IN_AN_EPISODE

if TYPE_CHECKING:
    import pandas

    from grasp_factory.dataset.dataset import Dataset

LEFT_OUT = ("spec", *(path.removeprefix("episodes/") for path in NOT_IN_AN_EPISODE))
"""Columns that a table has only if they are asked for: the recipe, checksums and the status."""


def pandas_table(dataset: Dataset, columns: Sequence[str] | None = None) -> pandas.DataFrame:
    """Return columns of a dataset's episodes; see ``Dataset.to_pandas``."""
    require("pandas", extra="pandas")
    import pandas  # noqa: PLC0415

    names = [n for n in dataset.columns if n not in LEFT_OUT] if columns is None else columns
    episodes = dataset.select(dataset.committed)
    data = {
        name: _cells(dataset.features[f"episodes/{name}"], values)
        for name, values in episodes.read_columns(*names).items()
    }
    return pandas.DataFrame(data, index=pandas.Index(episodes.indices, name="row"))


def _cells(field: Field, values: NDArray[Any]) -> Any:
    """Return the values of a column as pandas holds them."""
    import pandas  # noqa: PLC0415

    if values.ndim > 1:
        return list(values)
    if field.names:
        codes = np.where(values < len(field.names), values.astype(int), -1)
        return pandas.Categorical.from_codes(codes, pandas.Index(field.names))
    return values.tolist() if values.dtype.kind == "T" else values
