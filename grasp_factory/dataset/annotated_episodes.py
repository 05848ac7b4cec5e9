"""What was said of episodes after they were made: annotations of people, and added labels."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Self

import numpy as np
from numpy.typing import NDArray

from grasp_factory.dataset.annotations import Annotation, AnnotationLog
from grasp_factory.dataset.annotations.values import checked_tag
from grasp_factory.dataset.checked_reader import CheckedColumns, checked_label
from grasp_factory.dataset.episode_views import EpisodeViews
from grasp_factory.dataset.features import Features
from grasp_factory.dataset.joined_stores import (
    JoinedAnnotations,
    JoinedColumns,
    joined_name,
    places_by_store,
)
from grasp_factory.dataset.row_lookup import RowIndex
from grasp_factory.dataset.sensor_reader import Readings
from grasp_factory.errors import UsageError, lookup
from grasp_factory.writers.zarr.columns import Columns
from grasp_factory.writers.zarr.header import open_store
from grasp_factory.writers.zarr.label_columns import (
    NOT_LABELLED,
    added_columns,
    added_labels,
    label_thresholds,
    read_label,
)


class AnnotatedEpisodes(EpisodeViews):
    """Episodes with annotations and added labels.

    Attributes:
        paths: the path of the store, or of each.
        starts: the first row of each store, and the number of all rows, (K + 1,).
    """

    paths: tuple[Path, ...]
    starts: NDArray[np.int64]
    _is_checked: bool

    def __init__(
        self,
        columns: Columns | CheckedColumns | JoinedColumns,
        features: Features,
        rows: RowIndex,
        readings: Readings,
        annotations: AnnotationLog | JoinedAnnotations,
    ) -> None:
        """Use a store's columns, features, row index, readings, and its log of annotations."""
        super().__init__(columns, features, rows, readings)
        self._annotations = annotations

    @property
    def path(self) -> Path:
        """The path of the store.

        Raises:
            UsageError: for several stores, as what needs it takes one only.
        """
        if len(self.paths) > 1:
            names = ", ".join(map(str, self.paths))
            raise UsageError(f"{names}: got {len(self.paths)} stores, valid: one, for this")
        return self.paths[0]

    @property
    def name(self) -> str:
        """The path of the store, or of the first of several and their number, for messages."""
        return joined_name(self.paths)

    def stored_at(self, index: int) -> tuple[Path, int]:
        """Return the store of a row, and its row there.

        Raises:
            IndexError: naming the valid range.
        """
        row = self._rows.rows_at([index])
        ((store, _),) = places_by_store(row, self.starts)
        return self.paths[store], int(row[0] - self.starts[store])

    @property
    def annotations(self) -> Mapping[int, Annotation]:
        """The current annotations by index, including those of quarantined rows.

        Raises:
            StoreError: if they cannot be read. Damaged lines of the log are skipped.
        """
        said, chosen = self._annotations.annotations(), self._rows.chosen
        if chosen is None:
            return said
        return {k: said[row] for k, row in enumerate(chosen.tolist()) if row in said}

    def tagged(self, *tags: str) -> Self:
        """Return a view of the episodes that have all these tags.

        Raises:
            UsageError: if no tag is named, or one is invalid.
            StoreError: if the annotations cannot be read.
        """
        wanted = {checked_tag(tag) for tag in tags}
        if not wanted:
            raise UsageError("no tags: name one or more")
        found = [row for row, said in self.annotations.items() if wanted.issubset(said.tags)]
        return self._view(self._rows.rows_at(np.intersect1d(found, self.committed)))

    @property
    def labels(self) -> list[str]:
        """Names of the additional labels, which ``grasp-factory relabel`` made in all stores."""
        return sorted(set.intersection(*(set(added_labels(path)) for path in self.paths)))

    def label(self, name: str) -> NDArray[np.uint8]:
        """Return an added label's outcomes, one for each row that existed when it was made.

        A view has an outcome for each of its rows, 255 for a row that was added later.

        Raises:
            UnknownNameError: listing the labels.
        """
        lookup(dict.fromkeys(self.labels), "label", name)
        rows = np.diff(self.starts).tolist()
        found = [self._label_of(path, name, n) for path, n in zip(self.paths, rows, strict=True)]
        if self._rows.chosen is None and len(found) == 1:
            return found[0]
        whole = [
            np.pad(outcome, (0, n - len(outcome)), constant_values=NOT_LABELLED)
            for outcome, n in zip(found, rows, strict=True)
        ]
        return np.concatenate(whole)[
            slice(None) if self._rows.chosen is None else self._rows.chosen
        ]

    def _label_of(self, path: Path, name: str, rows: int) -> NDArray[np.uint8]:
        root, _ = open_store(path, mode="r")
        outcome = read_label(root, f"labels/{name}/outcome", rows)
        return checked_label(path, name, outcome) if self._is_checked else outcome

    def label_thresholds(self, name: str) -> dict[str, float | None]:
        """Return the thresholds that an added label was made with, by name.

        Raises:
            UnknownNameError: listing the labels.
            StoreError: if they are damaged.
        """
        lookup(dict.fromkeys(self.labels), "label", name)
        attributes = added_columns(self.path)[f"labels/{name}/outcome"].attrs.asdict()
        return label_thresholds(f"{self.path}: labels/{name}", attributes)
