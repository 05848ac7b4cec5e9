"""Reading whole episodes of a store, as the records that were written."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from grasp_factory.core import schema
from grasp_factory.core.config.factory_config import FactoryConfig
from grasp_factory.core.content_checksum import checksum
from grasp_factory.core.episode import Episode
from grasp_factory.core.schema import Field
from grasp_factory.dataset.plausible import check_plausible
from grasp_factory.dataset.row_codec import (
    Row,
    assemble,
    read_alone,
    read_rows,
    read_together,
)
from grasp_factory.dataset.row_integrity import episode_contents
from grasp_factory.errors import StoreError, lookup
from grasp_factory.signals.noise import EpisodeNoise, named_noise
from grasp_factory.writers.zarr.array_reader import StoredArray
from grasp_factory.writers.zarr.writer import COMMITTED

MOST_STILLS = 16 * 2**20
"""Bytes of the images before and after, of a block, that are read together."""


class Episodes:
    """Episodes of committed rows, clean or with noise."""

    def __init__(
        self,
        store: Path,
        config: FactoryConfig,
        arrays: Mapping[str, StoredArray],
        fields: Mapping[str, Field],
        noise: EpisodeNoise,
    ) -> None:
        """Use the arrays and fields, by their path, of the store at ``store``."""
        self._store, self._config, self._noise = store, config, noise
        self._arrays, self._fields = arrays, fields

    def one(self, row: int) -> Episode:
        """Return the episode of a row.

        Raises:
            StoreError: if it is damaged.
        """
        return self._episode(row, self._rows(row, row + 1)[0])

    def several(self, rows: NDArray[np.int64]) -> list[Episode]:
        """Return the episode of each of K rows of a block; a row that comes twice yields it twice.

        Raises:
            StoreError: if one is damaged.
        """
        wanted = np.unique(rows)
        found = dict(zip(wanted.tolist(), self.each(wanted), strict=True))
        return [found[row] for row in rows.tolist()]

    def of_blocks(
        self, rows: NDArray[np.int64], series: Iterable[str] | None = None
    ) -> Iterator[Episode]:
        """Return the episode of each of K rows of any blocks, in their order; see ``each``.

        Args:
            rows: the rows, (K,).
            series: see ``Dataset.iter_episodes``.

        Raises:
            UnknownNameError: for a time series that does not exist.
            StoreError: if the store lacks one, or while reading, if an episode is damaged.
        """
        fields = self._fields if series is None else self._with_series(map(str, series))
        changes = np.flatnonzero(np.diff(rows // self._config.block_size)) + 1
        blocks = np.split(rows, changes)
        return chain.from_iterable(self.each(block, fields) for block in blocks)

    def each(
        self, rows: NDArray[np.int64], fields: Mapping[str, Field] | None = None
    ) -> Iterator[Episode]:
        """Yield the episode of each of K rows of a block, in their order.

        Consecutive rows are read together, also across rows without an episode, but for videos and
        large images: those of one episode are in memory. Only the requested episodes are read.

        Args:
            rows: the rows, (K,).
            fields: what is read of them; None for everything.

        Raises:
            StoreError: if one is damaged.
        """
        wanted = np.unique(rows)
        if not len(wanted):
            return
        start, stop = int(wanted[0]), int(wanted[-1]) + 1
        is_other = self._read(schema.STATUS.path, start, stop) == COMMITTED
        is_other[wanted - start] = False
        run_of = np.cumsum(is_other)[wanted - start]
        fields = self._fields if fields is None else fields
        large = self._large_images(fields)
        others = {path: field for path, field in fields.items() if path not in large}
        read: dict[int, Row] = {}
        for run in np.split(wanted, np.flatnonzero(np.diff(run_of)) + 1):
            first, last = int(run[0]), int(run[-1])
            read.update(enumerate(read_together(self._read, others, first, last + 1), first))
        for row in rows.tolist():
            yield self._episode(row, read[row] | read_alone(self._read, large, row, read[row]))

    def _with_series(self, names: Iterable[str]) -> Mapping[str, Field]:
        """Return the fields without time series that are not wanted; each group has its times."""
        of_config = {field.path: field for field in schema.expand(self._config)}
        fields = of_config | dict(self._fields)
        every = {path: field for path, field in fields.items() if field.length_column}
        wanted = {name: lookup(every, "time series", name) for name in names}
        for name in wanted.keys() - self._fields.keys():
            what = f"{name} is missing; run grasp-factory verify on the store"
            raise StoreError(f"{self._store} is damaged: {what}")
        if self._noise.noise != named_noise(None):
            return self._fields
        wanted |= {path: field for path, field in every.items() if path.endswith("/timestamp")}
        return {p: f for p, f in self._fields.items() if p not in every or p in wanted}

    def _large_images(self, fields: Mapping[str, Field]) -> dict[str, Field]:
        """Return the fields of videos, and of other images if those of a block are large."""
        shapes = {p: self._arrays[p].zarr for p, field in fields.items() if field.is_image}
        stills = sum(
            array.dtype.itemsize * math.prod(array.shape[1:])
            for path, array in shapes.items()
            if not fields[path].is_video
        )
        is_large = stills * self._config.block_size > MOST_STILLS
        return {p: fields[p] for p in shapes if is_large or fields[p].is_video}

    def is_whole(self, row: int) -> bool:
        """Return whether an episode's values match its checksum."""
        try:
            read = self._rows(row, row + 1)[0]
        except StoreError:
            return False
        return checksum(episode_contents(read)) == str(read[schema.CHECKSUM.path])

    def _rows(self, start: int, stop: int) -> list[Row]:
        return read_rows(self._read, self._fields, start, stop)

    def _read(self, path: str, start: int, stop: int) -> NDArray[Any]:
        return self._arrays[path].read(start, stop)

    def _episode(self, row: int, read: Row) -> Episode:
        try:
            episode = assemble(read, self._config.cameras)
            check_plausible(episode, self._config)
        except (KeyError, TypeError, ValueError, RecursionError) as error:
            raise StoreError(f"{self._store}: episode {row} is damaged: {error}") from None
        return self._noise.episode(episode)
