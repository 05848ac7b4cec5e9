"""The store that is packed: its files must be laid out as this package writes them."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from grasp_factory.core.config.factory_config import FactoryConfig
from grasp_factory.core.json_text import parsed
from grasp_factory.core.limits import DOCUMENT
from grasp_factory.core.place import place_of
from grasp_factory.core.schema import Field
from grasp_factory.curation.merge.source_store import SourceStore
from grasp_factory.errors import StoreMismatchError
from grasp_factory.writers.zarr.array_reader import StoredArray
from grasp_factory.writers.zarr.columns import Columns
from grasp_factory.writers.zarr.field_arrays import open_arrays
from grasp_factory.writers.zarr.header import open_store
from grasp_factory.writers.zarr.layout import documents
from grasp_factory.writers.zarr.writer import MISSING

_LAYOUT = ("shape", "data_type", "chunk_grid", "chunk_key_encoding", "fill_value", "codecs")


class PackSource:
    """A store whose blocks are joined.

    Attributes:
        store: the store, as it was when it was opened.
        place: its directory.
        config: its config.
        fields: the fields of its arrays, by path.
        arrays: its arrays, by path.
        length: its rows.
        checksums: of all rows, (N,).
    """

    def __init__(self, path: Path) -> None:
        """Open the store at ``path``.

        Raises:
            StoreMismatchError: if there is no store, or another program has rewritten an array.
            StoreError: if it is damaged.
        """
        self.store = SourceStore(path)
        self.place, self.config = place_of(path), self.store.config
        self.fields: Mapping[str, Field] = self.store.reader.fields
        self.length = len(self.store)
        root, _ = open_store(path, mode="r")
        self.arrays: dict[str, StoredArray] = open_arrays(
            root, self.config, self.fields, set(self.fields)
        )
        self._check_layout(path)
        self.checksums: NDArray[Any] = self.store.checksums()

    def check_rows(self, together: int | None) -> None:
        """Check that no row is missing; or, of each ``together`` rows, that all are or none is.

        Raises:
            StoreMismatchError: if more are missing, or there is no row at all.
        """
        is_missing = self.store.status == MISSING
        if together:
            block = np.arange(self.length) // together
            there = np.bincount(block, ~is_missing)
            is_missing &= there[block] > 0
        missing = int(is_missing.sum())
        if missing or not self.length:
            raise StoreMismatchError(
                f"{missing} of {self.length} rows of {self.store.path} are missing: complete it"
                " with `grasp-factory generate`, or copy what is there with `grasp-factory split`"
            )

    def is_as_opened(self) -> bool:
        """Return whether the rows are still those that were there when it was opened."""
        return is_same_content(self.store.path, self.store.status, self.checksums)

    def _check_layout(self, path: Path) -> None:
        own = list(self.fields.values())
        expected = documents(own, self.config, self.store.reader.joints, self.length)
        for name, document in expected.items():
            found = parsed((self.place / name / "zarr.json").read_bytes(DOCUMENT))
            if any(found.get(key) != document[key] for key in _LAYOUT):
                raise StoreMismatchError(
                    f"{path}: {name} has another layout than this version writes: copy the store"
                    " with `grasp-factory merge OUT STORE` first, which writes it again"
                )

    def packed_attributes(self, config: FactoryConfig) -> dict[str, Any]:
        """Return the root attributes of a store of the same rows that has another config."""
        own = {
            "config": config.to_plain(),
            "config_sha256": config.sha256(),
            "block_size": config.block_size,
        }
        return {key: own.get(key, value) for key, value in self.store.attributes.items()}


def is_same_content(path: Path, status: NDArray[np.uint8], checksums: NDArray[Any]) -> bool:
    """Return whether the rows of a store have these statuses and checksums, (N,) each."""
    found = Columns.open(path).read("status", "checksum")
    same = np.array_equal(found["status"], status)
    return same and found["checksum"].tolist() == checksums.tolist()
