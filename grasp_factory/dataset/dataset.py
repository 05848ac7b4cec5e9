"""Reading a store: open it, select rows, and get the records that were written."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, overload

import numpy as np
import zarr
from numpy.typing import NDArray

from grasp_factory.core import schema
from grasp_factory.core.config.factory_config import FactoryConfig
from grasp_factory.core.episode import Episode, EpisodeSpec, ObjectSpec
from grasp_factory.core.triangle_mesh import TriangleMesh
from grasp_factory.dataset.annotations import Annotation, AnnotationLog
from grasp_factory.dataset.annotations.values import checked_tag
from grasp_factory.dataset.checked_reader import CheckedColumns, checked_arrays, checked_label
from grasp_factory.dataset.episode_reader import Episodes
from grasp_factory.dataset.episode_views import EpisodeViews
from grasp_factory.dataset.object_meshes import recipe_mesh
from grasp_factory.dataset.row_codec import NEEDED
from grasp_factory.dataset.row_integrity import must_have_fingerprints
from grasp_factory.dataset.row_lookup import RowIndex, chosen_rows
from grasp_factory.dataset.sensor_reader import Readings
from grasp_factory.errors import StoreError, UsageError, lookup
from grasp_factory.signals.noise import EpisodeNoise, SensorNoise, named_noise
from grasp_factory.writers.zarr.array_reader import StoredArray
from grasp_factory.writers.zarr.columns import Columns
from grasp_factory.writers.zarr.field_arrays import open_arrays
from grasp_factory.writers.zarr.header import SOURCES, open_store
from grasp_factory.writers.zarr.label_columns import (
    added_columns,
    added_labels,
    label_thresholds,
    read_label,
)

if TYPE_CHECKING:
    from grasp_factory.writers.exporters.exporting import Exported


class Dataset(EpisodeViews):
    """A store, opened for reading. Opening or reading never runs code from it.

    Attributes:
        path: the path of the store.
        config: the configuration that it was made from.
        attributes: all root attributes: seed, versions, conventions, ...
    """

    def __init__(
        self,
        path: Path,
        config: FactoryConfig,
        attributes: Mapping[str, Any],
        arrays: Mapping[str, StoredArray],
        noise: EpisodeNoise,
        *,
        checked: bool = False,
    ) -> None:
        """Create a dataset; users call ``Dataset.open`` instead."""
        self.path = path
        self.config = config
        self.attributes = attributes
        self._arrays = arrays
        self._noise, self._is_checked = noise, checked
        fields = {row.path: row for row in schema.expand(config) if row.path in arrays}
        columns = Columns(path, config, arrays)
        shown = CheckedColumns(columns, arrays) if checked else columns
        rows = RowIndex(path, arrays, config.block_size)
        super().__init__(shown, fields, rows, Readings(path, config, arrays, fields, noise))
        self._episodes = Episodes(path, config, arrays, fields, noise)
        self._annotations = AnnotationLog(path)

    @classmethod
    def open(
        cls,
        path: Path | str,
        noise: str | SensorNoise | None = None,
        noise_seed: int = 0,
        *,
        checked: bool = False,
    ) -> Dataset:
        """Open the store at ``path``.

        Args:
            path: the path of the store.
            noise: the sensor noise that is added to episodes, images and series when they are
                read, or its name in ``noise.NOISE``; columns and the store itself stay clean.
            noise_seed: the same seed yields the same noise.
            checked: compare values of committed rows with their checksums as they are read; a
                mismatch is a StoreError that names episode and array.

        Raises:
            StoreMismatchError: if there is no store, or it has a newer version.
            StoreError: if the store is damaged.
            UsageError: for an invalid noise or seed.
        """
        path, shown_as = Path(path), EpisodeNoise(named_noise(noise), noise_seed)
        root, config = open_store(path, mode="r")
        needed = {f"episodes/{name}" for name in NEEDED}
        fields = {row.path: row for row in schema.expand(config)}
        arrays = open_arrays(root, config, fields, needed)
        for name in sorted({fields[p].length_column for p in arrays} - {"", *arrays}):
            what = f"array {name} is missing; run grasp-factory verify on it, and repair"
            raise StoreError(f"{path} is damaged: {what}")
        if checked:
            seed = None if SOURCES in root.attrs else config.seed
            required = must_have_fingerprints(root.attrs)
            arrays = checked_arrays(path, arrays, fields, seed, has_fingerprints=required)
        return cls(path, config, root.attrs.asdict(), arrays, shown_as, checked=checked)

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickle as the arguments of ``open``; another process opens the store again."""
        again = partial(Dataset.open, checked=self._is_checked)
        return again, (self.path, self._noise.noise, self._noise.seed)

    def __repr__(self) -> str:
        return f"Dataset({str(self.path)!r}, {len(self)} episodes)"

    @overload
    def __getitem__(self, index: int) -> Episode: ...

    @overload
    def __getitem__(self, index: slice | Sequence[int] | NDArray[Any]) -> list[Episode]: ...

    def __getitem__(self, index: Any) -> Episode | list[Episode]:
        """Return the episode at an index, or a list of the episodes at several indices.

        Negative indices count from the end. Several indices are a slice, or a list, range or
        array of integers in any order, such as ``where`` returns. All their episodes are in memory
        at once; for many episodes, use ``iter_blocks``.

        Raises:
            IndexError: naming the valid range.
            TypeError: for anything else, including a boolean mask.
            StoreError: if a row is missing, quarantined or damaged.
        """
        if isinstance(index, slice | list | range | np.ndarray):
            return self._episodes.several(self._rows.several(index))
        return self._episodes.one(self._rows.committed(index))

    def __iter__(self) -> Iterator[Episode]:
        """Iterate over the committed episodes."""
        for _, episodes in self.iter_blocks():
            yield from episodes

    def iter_blocks(
        self, rows: Iterable[int] | None = None
    ) -> Iterator[tuple[NDArray[np.int64], list[Episode]]]:
        """Iterate over (indices, episodes) of each block; one block at a time is in memory.

        Consecutive rows are read together. Only the requested episodes are read, each once.

        Args:
            rows: The rows to read; None for all committed rows, ascending. Blocks are yielded in
                the order in which the rows first name them, and the rows of a block in the order
                given. A row that is given twice is yielded twice.

        Raises:
            TypeError, IndexError, StoreError: as for ``dataset[rows]``.
        """
        return self._episodes.blocks(self.committed if rows is None else self._rows.several(rows))

    def spec(self, index: int) -> EpisodeSpec:
        """Return the recipe of an episode, also of a quarantined one.

        Raises:
            IndexError: naming the valid range.
            StoreError: if the row is missing or damaged.
        """
        return self._readings.spec(self._rows.present(index)[0])

    def object_mesh(self, recipe: ObjectSpec) -> TriangleMesh:
        """Return the surface of an object of a recipe of this store, in the object's own frame.

        Raises:
            UsageError: if this machine cannot build it: the message says what to install or import.
            StoreError: if the objects that the store contains are damaged or too large.
        """
        return recipe_mesh(self.path, self.config, recipe)

    def value(self, index: int, column: str) -> Any:
        """Return the value of one column for one episode; no other column is read.

        Returns:
            A numpy scalar, a string, or an array for columns with more than one value per row.

        Raises:
            UnknownNameError: listing the columns.
            IndexError: naming the valid range.
            StoreError: if the row is missing, quarantined or damaged.
        """
        self._check_column(column)
        i = self._rows.committed(index)
        return self._arrays[f"episodes/{column}"].read(i, i + 1)[0]

    @property
    def annotations(self) -> Mapping[int, Annotation]:
        """The current annotations by row, including those of quarantined rows.

        Raises:
            StoreError: if they cannot be read. Damaged lines of the log are skipped.
        """
        return self._annotations.annotations()

    def tagged(self, *tags: str) -> NDArray[np.int64]:
        """Return the committed rows that have all these tags, ascending, (K,).

        Raises:
            UsageError: if no tag is named, or one is invalid.
            StoreError: if the annotations cannot be read.
        """
        wanted = {checked_tag(tag) for tag in tags}
        if not wanted:
            raise UsageError("no tags: name one or more")
        found = [row for row, said in self.annotations.items() if wanted.issubset(said.tags)]
        return np.intersect1d(np.array(found, np.int64), self.committed)

    @property
    def labels(self) -> list[str]:
        """Names of the additional labels, which ``grasp-factory relabel`` made."""
        return added_labels(self.path)

    def label(self, name: str) -> NDArray[np.uint8]:
        """Return an added label's outcomes, one for each row that existed when it was made.

        Raises:
            UnknownNameError: listing the labels.
        """
        lookup(dict.fromkeys(self.labels), "label", name)
        root, _ = open_store(self.path, mode="r")
        outcome = read_label(root, f"labels/{name}/outcome", len(self))
        return checked_label(self.path, name, outcome) if self._is_checked else outcome

    def label_thresholds(self, name: str) -> dict[str, float | None]:
        """Return the thresholds that an added label was made with, by name.

        Raises:
            UnknownNameError: listing the labels.
            StoreError: if they are damaged.
        """
        lookup(dict.fromkeys(self.labels), "label", name)
        attributes = added_columns(self.path)[f"labels/{name}/outcome"].attrs.asdict()
        return label_thresholds(f"{self.path}: labels/{name}", attributes)

    def arrays(self) -> dict[str, zarr.Array[Any]]:
        """Return every array of the store by its path, including added labels."""
        own = {path: array.zarr for path, array in self._arrays.items()}
        return {**own, **added_columns(self.path)}

    def export(
        self,
        to: str,
        out: Path | str,
        rows: Iterable[int] | None = None,
        *,
        workers: int = 1,
        **settings: Any,
    ) -> Exported:
        """Write episodes in the format of another tool to the folder ``out``.

        Args:
            to: the format; ``grasp-factory export --list`` lists all of them.
            out: the folder to create; it must not exist.
            rows: rows that hold an episode, in the order of the export, or a mask of truth values,
                one for each row of the store; None for all episodes.
            workers: number of processes; the files do not depend on it.
            **settings: options of the format.

        Raises:
            UnknownNameError: for an unknown format.
            UsageError: for a place that is taken, a missing library, rows that are no rows of
                episodes, or episodes that the format cannot hold.
            ConfigError: for an invalid setting.
            StoreError: if the store is damaged, or the disk fails or is full.
        """
        from grasp_factory.writers.exporters import exporter_named  # noqa: PLC0415
        from grasp_factory.writers.exporters.exporting import run_export  # noqa: PLC0415

        exporter = exporter_named(to)
        chosen = self.committed.tolist() if rows is None else chosen_rows(rows, len(self))
        return run_export(exporter, [(self, chosen)], Path(out), settings, workers=workers)

    def verify(self, index: int) -> bool:
        """Return whether an episode's values match its checksum.

        Raises:
            IndexError: naming the valid range.
            StoreError: if the row is missing or quarantined.
        """
        return self._episodes.is_whole(self._rows.committed(index))
