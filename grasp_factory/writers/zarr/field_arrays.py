"""Opening the arrays of a store's fields, and checking that they fit the fields."""

from __future__ import annotations

from collections.abc import Mapping, Set
from typing import Any

import numpy as np
import zarr

from grasp_factory.core import schema
from grasp_factory.core.config.factory_config import FactoryConfig
from grasp_factory.core.field import Field
from grasp_factory.core.limits import DOCUMENT
from grasp_factory.errors import StoreError, shown
from grasp_factory.writers.zarr.array_layout import stored
from grasp_factory.writers.zarr.array_reader import StoredArray
from grasp_factory.writers.zarr.budgets import check_arrays
from grasp_factory.writers.zarr.header import open_array, place_in


def open_arrays(
    root: zarr.Group, config: FactoryConfig, fields: Mapping[str, Field], needed: Set[str]
) -> dict[str, StoredArray]:
    """Return the arrays of fields of a store by path; those that are not needed may be missing.

    A store that was made before an array was added to the schema lacks it.

    Raises:
        StoreError: if one that is needed is missing, one is damaged, or no array of its field.
    """
    store = place_in(root)
    store.root.fetch_ahead([f"{path}/zarr.json" for path in fields], DOCUMENT)
    there = [p for p in fields if p in needed or (store / p / "zarr.json").exists()]
    opened = {p: open_array(root, p) for p in there}
    check_arrays(store, config, opened.values())
    sizes = schema.scene_sizes(config)
    for path, array in opened.items():
        _check_field(array, fields[path], sizes)
    return {path: stored(array) for path, array in opened.items()}


def _check_field(array: zarr.Array[Any], field: Field, sizes: dict[str, int]) -> None:
    """Check the type, the lengths and the fill value of an array.

    Lengths with a letter are the same in all arrays of a store: those that are known are in
    ``sizes``, and the others are added.
    """
    is_text, rest = field.dtype == "string", array.shape[1:]
    fits = array.dtype.kind == "T" if is_text else array.dtype == np.dtype(field.dtype)
    fits &= len(rest) == len(field.dims) and all(
        size == (sizes.setdefault(dim, max(1, size)) if isinstance(dim, str) else dim)
        for dim, size in zip(field.dims, rest, strict=True)
    )
    if not fits:
        got = f"is {array.dtype} of {' x '.join(map(str, array.shape))}"
        lengths = ("N", *(sizes.get(str(dim), dim) for dim in field.dims))
        valid = f"{field.dtype} of {' x '.join(map(str, lengths))}"
        raise StoreError(f"{array.store} is damaged: {array.path} {got}, valid: {valid}")
    if is_text and array.fill_value != "":
        got = f"has the fill value {shown(array.fill_value)}"
        raise StoreError(f"{array.store} is damaged: {array.path} {got}, valid: an empty text")
