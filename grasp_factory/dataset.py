"""Reading a store: open it, pick rows, get back the very records that were written."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import zarr
from numpy.typing import NDArray

from grasp_factory import schema
from grasp_factory.checked import CheckedColumns, checked_arrays, checked_label
from grasp_factory.conditions import matching
from grasp_factory.config import FactoryConfig
from grasp_factory.episode import Episode, EpisodeSpec, checksum
from grasp_factory.errors import StoreError, lookup
from grasp_factory.noise import EpisodeNoise, SensorNoise, named_noise
from grasp_factory.readings import Readings
from grasp_factory.records import is_integer
from grasp_factory.rows import NEEDED, Row, assemble, read_rows
from grasp_factory.writers.added import added_columns, added_labels
from grasp_factory.writers.columns import Columns
from grasp_factory.writers.header import SOURCES, open_store, read_array
from grasp_factory.writers.stored import StoredArray, open_arrays


class Dataset:
    """A store, opened for reading. Opening or reading never runs code from it.

    Attributes:
        path: where it is.
        config: what it was made from.
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
        """Use ``Dataset.open``."""
        self.path = path
        self.config = config
        self.attributes = attributes
        self._arrays = arrays
        self._noise, self._is_checked = noise, checked
        self._fields = {row.path: row for row in schema.expand(config) if row.path in arrays}
        columns = Columns(path, config, arrays)
        self._columns = CheckedColumns(columns, arrays) if checked else columns
        self._readings = Readings(path, config, arrays, self._fields, noise)

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
            path: where it is.
            noise: what sensors add to episodes, images and series when they are read, or its name
                in ``noise.NOISE``; columns stay clean, and so does the store.
            noise_seed: the same seed gives the same noise.
            checked: compare whatever is read of committed rows with its checksum first; what does
                not match is a StoreError that names episode and array.

        Raises:
            StoreMismatchError: if there is no store, or one of a newer version.
            StoreError: if the store is damaged.
            UsageError: for a noise or a seed that is none.
        """
        path, shown_as = Path(path), EpisodeNoise(named_noise(noise), noise_seed)
        root, config = open_store(path, mode="r")
        needed = {f"episodes/{name}" for name in NEEDED}
        fields = {row.path: row for row in schema.expand(config)}
        arrays = open_arrays(root, path, fields, needed)
        if checked:
            seed = None if SOURCES in root.attrs else config.seed
            arrays = checked_arrays(path, arrays, fields, seed)
        return cls(path, config, root.attrs.asdict(), arrays, shown_as, checked=checked)

    def __reduce__(self) -> tuple[Any, ...]:
        """Travel to another process as what it was opened with, to be opened there."""
        again = partial(Dataset.open, checked=self._is_checked)
        return again, (self.path, self._noise.noise, self._noise.seed)

    def __repr__(self) -> str:
        return f"Dataset({str(self.path)!r}, {len(self)} episodes)"

    def __len__(self) -> int:
        """Return the number of rows, whatever their status."""
        return self._columns.length

    @property
    def columns(self) -> list[str]:
        """Names for ``column`` and ``where``."""
        return list(self._columns.names)

    def column(self, name: str) -> NDArray[Any]:
        """Return a whole column, shape (N, ...); rows that are missing hold its fill value.

        Raises:
            UnknownNameError: listing the columns.
            StoreError: if it is damaged.
        """
        self._check_column(name)
        return self._columns.read(name)[name]

    @property
    def status(self) -> NDArray[np.uint8]:
        """The rows' status as it is now, (N,): 0 missing, 1 committed, 2 quarantined."""
        return self.column("status")

    @property
    def committed(self) -> NDArray[np.int64]:
        """Indices of the rows that hold an episode, ascending."""
        return np.flatnonzero(self.status == 1)

    def where(self, **conditions: Any) -> NDArray[np.int64]:
        """Return the committed rows in which each named column has the value, or one of a list.

        A word that no row of a text column has, as in ``policy="nope"``, matches no row.

        Example: ``where(success=False, outcome=["no_contact", "collision"], split="train")``.

        Raises:
            UnknownNameError: for a column that does not exist, or a word that a column of words
                does not know.
            UsageError: for a column with more than one value per row.
        """
        for name in conditions:
            self._check_column(name)
        columns = self._columns.read("status", *conditions)
        keep = columns["status"] == 1
        for name, value in conditions.items():
            keep &= matching(self._fields[f"episodes/{name}"], columns[name], value)
        return np.flatnonzero(keep)

    def __getitem__(self, index: int) -> Episode:
        """Return the episode that was written at ``index``; negative counts from the end.

        Raises:
            IndexError: naming the valid range.
            TypeError: for anything but an integer.
            StoreError: if the row is missing, quarantined or damaged.
        """
        i = self._readings.committed_row(index)
        return self._episode(i, read_rows(self._read, self._fields, i, i + 1)[0])

    def __iter__(self) -> Iterator[Episode]:
        """Iterate over the committed episodes."""
        for _, episodes in self.iter_blocks():
            yield from episodes

    def iter_blocks(self) -> Iterator[tuple[NDArray[np.int64], list[Episode]]]:
        """Iterate over (indices, episodes) of each block's committed rows, reading shards once."""
        committed, size = self.committed, self.config.block_size
        for indices in np.split(committed, np.flatnonzero(np.diff(committed // size)) + 1):
            if len(indices) == 0:  # of a store without any
                return
            start = int(indices[0]) // size * size
            rows = read_rows(self._read, self._fields, start, min(start + size, len(self)))
            yield indices, [self._episode(int(i), rows[i - start]) for i in indices]

    def spec(self, index: int) -> EpisodeSpec:
        """Return the recipe of an episode, also of a quarantined one.

        Raises:
            IndexError: naming the valid range.
            StoreError: if the row is missing or damaged.
        """
        return self._readings.spec(self._readings.present_row(index)[0])

    def value(self, index: int, column: str) -> Any:
        """Return one column's value of one episode, reading no other.

        Returns:
            A numpy scalar, a string, or an array for columns with more than one value a row.

        Raises:
            UnknownNameError: listing the columns.
            IndexError: naming the valid range.
            StoreError: if the row is missing, quarantined or damaged.
        """
        self._check_column(column)
        i = self._readings.committed_row(index)
        return self._read(f"episodes/{column}", i, i + 1)[0]

    def image(self, index: int, camera: str, kind: str, frame: int) -> NDArray[Any]:
        """Return one image, reading no other.

        Args:
            index: the episode's.
            camera: a key of ``config.cameras``.
            kind: rgb (H, W, 3) uint8, depth (H, W) float32 in metres, or segmentation (H, W) uint8.
            frame: 0 before the attempt, 1 after.

        Raises:
            UnknownNameError: for a camera or kind that the store does not have.
            IndexError: for an episode or a frame out of range.
            StoreError: if the row is missing, quarantined or damaged.
        """
        image: NDArray[Any] = self.images([index], camera, kind, frame)[0]
        return image

    def images(self, indices: Iterable[int], camera: str, kind: str, frame: int) -> NDArray[Any]:
        """Return the image of each of K episodes, (K, H, W, ...), opening each shard once.

        Args:
            indices: the episodes', in any order; the images come in theirs.
            camera: see ``image``.
            kind: see ``image``.
            frame: see ``image``.

        Raises:
            UnknownNameError, IndexError, StoreError: as ``image`` does.
        """
        self._readings.image_path(camera, kind)  # a wrong name is told before a wrong index
        if not is_integer(frame) or frame not in (0, 1):
            raise IndexError(f"frame {frame}: valid: 0 (before) and 1 (after)")
        rows = [self._readings.committed_row(index) for index in indices]
        return self._readings.images(rows, camera, kind, frame)

    def series(self, index: int, *names: str) -> dict[str, NDArray[Any]]:
        """Return some streams of one episode, unpadded, reading no others (than noise needs).

        Raises:
            UnknownNameError: listing the streams.
        """
        return self._readings.series(self._readings.committed_row(index), names)

    @property
    def labels(self) -> list[str]:
        """Names of the labels that were added to the store's own (``grasp-factory relabel``)."""
        return added_labels(self.path)

    def label(self, name: str) -> NDArray[np.uint8]:
        """Return an added label's outcomes, one for each row there was when it was made.

        Raises:
            UnknownNameError: listing the labels.
        """
        lookup(dict.fromkeys(self.labels), "label", name)
        outcome = read_array(added_columns(self.path)[f"labels/{name}/outcome"])
        return checked_label(self.path, name, outcome) if self._is_checked else outcome

    def arrays(self) -> dict[str, zarr.Array[Any]]:
        """Return every array of the store by its path, added labels included."""
        own = {path: array.zarr for path, array in self._arrays.items()}
        return {**own, **added_columns(self.path)}

    def verify(self, index: int) -> bool:
        """Say whether an episode still has the checksum that it was written with.

        Raises:
            IndexError: naming the valid range.
            StoreError: if the row is missing or quarantined.
        """
        i = self._readings.committed_row(index)
        try:
            row = read_rows(self._read, self._fields, i, i + 1)[0]
        except StoreError:
            return False
        contents = {p: v for p, v in row.items() if p not in schema.NOT_IN_AN_EPISODE}
        return checksum(contents) == str(row[schema.CHECKSUM.path])

    def _check_column(self, name: str) -> None:
        lookup(dict.fromkeys(self._columns.names), "column", name)

    def _read(self, path: str, start: int, stop: int) -> NDArray[Any]:
        return self._arrays[path].read(start, stop)

    def _episode(self, i: int, row: Row) -> Episode:
        try:
            episode = assemble(row, self.config.cameras)
        except (KeyError, TypeError, ValueError, RecursionError) as error:
            raise StoreError(f"{self.path}: episode {i} is damaged: {error}") from None
        return self._noise.episode(episode)
