"""Reading whole episodes of a store, as the records that were written."""

from __future__ import annotations

from collections.abc import Mapping
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
from grasp_factory.dataset.row_codec import Row, assemble, read_rows
from grasp_factory.dataset.row_integrity import episode_contents
from grasp_factory.errors import StoreError
from grasp_factory.signals.noise import EpisodeNoise
from grasp_factory.writers.zarr.array_reader import StoredArray
from grasp_factory.writers.zarr.writer import COMMITTED


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

        Consecutive rows are read together, also across rows without an episode. Only the
        requested episodes are read.

        Raises:
            StoreError: if one is damaged.
        """
        wanted = np.unique(rows)
        if not len(wanted):
            return []
        start, stop = int(wanted[0]), int(wanted[-1]) + 1
        is_other = self._read(schema.STATUS.path, start, stop) == COMMITTED
        is_other[wanted - start] = False
        run_of = np.cumsum(is_other)[wanted - start]
        found: dict[int, Episode] = {}
        for run in np.split(wanted, np.flatnonzero(np.diff(run_of)) + 1):
            first = int(run[0])
            read = self._rows(first, int(run[-1]) + 1)
            found |= {i: self._episode(i, read[i - first]) for i in run.tolist()}
        return [found[row] for row in rows.tolist()]

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
