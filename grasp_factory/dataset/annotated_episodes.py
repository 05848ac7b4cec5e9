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
        path: the path of the store.
    """

    path: Path

    def __init__(
        self,
        columns: Columns | CheckedColumns,
        features: Features,
        rows: RowIndex,
        readings: Readings,
        annotations: AnnotationLog,
    ) -> None:
        """Use a store's columns, features, row index, readings, and its log of annotations."""
        super().__init__(columns, features, rows, readings)
        self._annotations = annotations

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
        """Names of the additional labels, which ``grasp-factory relabel`` made."""
        return added_labels(self.path)

    def label(self, name: str) -> NDArray[np.uint8]:
        """Return an added label's outcomes, one for each row that existed when it was made.

        A view has an outcome for each of its rows, 255 for a row that was added later.

        Raises:
            UnknownNameError: listing the labels.
        """
        lookup(dict.fromkeys(self.labels), "label", name)
        root, _ = open_store(self.path, mode="r")
        outcome = read_label(root, f"labels/{name}/outcome", len(self.whole))
        if isinstance(self._columns, CheckedColumns):
            outcome = checked_label(self.path, name, outcome)
        if self._rows.chosen is None:
            return outcome
        later = np.full(len(self.whole) - len(outcome), NOT_LABELLED, np.uint8)
        return np.concatenate([outcome, later])[self._rows.chosen]

    def label_thresholds(self, name: str) -> dict[str, float | None]:
        """Return the thresholds that an added label was made with, by name.

        Raises:
            UnknownNameError: listing the labels.
            StoreError: if they are damaged.
        """
        lookup(dict.fromkeys(self.labels), "label", name)
        attributes = added_columns(self.path)[f"labels/{name}/outcome"].attrs.asdict()
        return label_thresholds(f"{self.path}: labels/{name}", attributes)
