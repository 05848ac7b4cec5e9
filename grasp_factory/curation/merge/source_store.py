"""A store that rows are taken from."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from grasp_factory.core.config.config_difference import first_difference
from grasp_factory.core.object_storage.address import store_path
from grasp_factory.core.place import place_of
from grasp_factory.core.platforms import FINGERPRINT, is_fingerprint
from grasp_factory.curation.merge.provenance import Maker, makers_of
from grasp_factory.curation.merge.union import Rows
from grasp_factory.dataset.dataset import Dataset
from grasp_factory.dataset.row_reader import RowReader, mending
from grasp_factory.errors import StoreError, StoreMismatchError
from grasp_factory.writers.zarr.files import locate
from grasp_factory.writers.zarr.header import SOURCES
from grasp_factory.writers.zarr.metadata_checksum import SEAL, is_sealed
from grasp_factory.writers.zarr.writer import QUARANTINED

_OF_EACH = {
    *("seed", "config", "config_sha256", "versions", "platform", FINGERPRINT, "created_by"),
    SOURCES,
}
"""Root attributes that may differ between stores that are merged."""


class SourceStore:
    """The state of a store when it is opened: blocks that are committed later are not in it.

    Attributes:
        path: the path that the user passed.
        place: this path after links are followed.
        attributes: the root's attributes, without the seal.
        status: (N,): 0 missing, 1 committed, 2 quarantined.
        is_collected: whether it is itself a merged or split store.
        makers: the makers of its rows, by seed.
        reader: reads its rows.
    """

    def __init__(self, path: Path | str) -> None:
        """Open the store at ``path``.

        Raises:
            StoreMismatchError: if there is no store, or its config is of another version.
            StoreError: if it is damaged.
        """
        self.path = store_path(path)
        self.place = locate(self.path)
        self._dataset = Dataset(self.path)
        if not is_sealed(place_of(self.path) / "zarr.json"):
            what = f"{self.path} is damaged: zarr.json is not as it was written"
            raise StoreError(f"{what}; {mending(self.path)}")
        self.attributes = {k: v for k, v in self._dataset.attributes.items() if k != SEAL}
        self._check_config()
        self.reader = RowReader(self.path)
        self.config = self.reader.config
        self.is_collected = SOURCES in self.attributes
        self.makers: dict[int, tuple[Maker, ...]] = makers_of(
            self.path, self.attributes, self.config.seed
        )
        self.status = self._dataset.status

    def __len__(self) -> int:
        """Return the number of rows of any status."""
        return len(self.status)

    def present(self) -> Rows:
        """Return the rows that are committed or quarantined.

        Raises:
            StoreError: if it is damaged.
        """
        return self.rows(np.flatnonzero(self.status))

    def rows(self, row: NDArray[np.int64]) -> Rows:
        """Return some rows with their recipes' seeds and indices.

        Raises:
            StoreError: if it is damaged.
        """
        is_quarantined = self.status[row] == QUARANTINED
        if not self.is_collected:
            seed = np.full(len(row), self.config.seed, np.int64)
            return Rows(row=row, seed=seed, index=row, is_quarantined=is_quarantined)
        seed, index = (self._dataset.column(name)[row] for name in ("seed", "index"))
        unknown = set(seed.tolist()) - set(self.makers)
        if unknown:
            what = f"{self.path} is damaged: {SOURCES} does not name seed {min(unknown)}"
            raise StoreError(f"{what}; get the store from its maker again")
        return Rows(row=row, seed=seed, index=index, is_quarantined=is_quarantined)

    def checksums(self) -> NDArray[Any]:
        """Return the stored checksum of every row, (N,).

        Raises:
            StoreError: if it is damaged.
        """
        return self._dataset.column("checksum")

    def fingerprints(self) -> dict[int, frozenset[str]]:
        """Return the known fingerprints of the platforms that made its rows, as texts by seed.

        Raises:
            StoreError: if it is damaged.
        """
        name, rows = "fingerprint", self.present()
        texts = [""] * len(rows.row)
        if name in self._dataset.columns:
            texts = self._dataset.column(name)[rows.row].tolist()
        told: dict[int, set[str]] = {}
        for seed, text in set(zip(rows.seed.tolist(), texts, strict=True)):
            if is_fingerprint(text):
                told.setdefault(seed, set()).add(text)
        return {seed: frozenset(found) for seed, found in told.items()}

    def labels(self) -> list[str]:
        """Return the names of the labels that were added to it."""
        return self._dataset.labels

    def label(self, name: str) -> tuple[NDArray[np.uint8], dict[str, Any]]:
        """Return an added label's outcomes and its array's attributes.

        Raises:
            StoreError: if it is damaged.
        """
        array = self._dataset.arrays()[f"labels/{name}/outcome"]
        return self._dataset.label(name), array.attrs.asdict()

    def check_fits(self, other: SourceStore) -> None:
        """Check that rows of this store and of another one can be in one store.

        Raises:
            StoreMismatchError: naming the first setting, or fact, in which they differ.
        """
        may_differ = {"seed"}
        if None in (self.config.capture, other.config.capture):
            may_differ.add("capture")  # simulated rows get empty arrays for what real ones have
        mine, others = (
            {k: v for k, v in side.attributes["config"].items() if k not in may_differ}
            for side in (self, other)
        )
        if found := first_difference(mine, others):
            raise StoreMismatchError(
                f"{self.path} is of another config than {other.path} ({found}); only the seed may"
                " differ"
            )
        self._check_arrays(other)
        mine, others = (
            {k: v for k, v in side.attributes.items() if k not in _OF_EACH}
            for side in (self, other)
        )
        if found := first_difference(mine, others):
            raise StoreMismatchError(
                f"{self.path} has other attributes than {other.path} ({found}): they were made by"
                " versions whose stores cannot be merged"
            )

    def _check_arrays(self, other: SourceStore) -> None:
        """Check that both stores have the same arrays: a sensor may have been added in between."""
        paths = [
            {path for path, field in side.reader.fields.items() if not field.is_real}
            for side in (self, other)
        ]
        odd = sorted(paths[0] ^ paths[1])
        if odd:
            has, lacks = (self, other) if odd[0] in self.reader.fields else (other, self)
            raise StoreMismatchError(
                f"{has.path} has the array {odd[0]}, which {lacks.path} lacks: versions with other"
                " sensors made them; merge stores of one version"
            )

    def _check_config(self) -> None:
        """Check that this version reads the config in the same way as the version that wrote it."""
        config = self._dataset.config
        if self.attributes["config_sha256"] != config.sha256():
            found = first_difference(self.attributes["config"], config.to_plain())
            raise StoreMismatchError(
                f"{self.path} was made by another version of grasp-factory"
                f" ({found or 'config_sha256'}): use that version"
            )
