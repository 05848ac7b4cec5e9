"""The episodes of an export: chosen rows of one or several stores, numbered from 0."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from grasp_factory.core.config.factory_config import FactoryConfig
from grasp_factory.core.episode import Episode, EpisodeSpec, ObjectSpec
from grasp_factory.core.geometry import Array
from grasp_factory.core.object_storage.address import real_path
from grasp_factory.core.real_columns import SOURCE, Source
from grasp_factory.core.schema import Field
from grasp_factory.core.triangle_mesh import TriangleMesh
from grasp_factory.errors import UsageError
from grasp_factory.writers.exporters.stores_alike import check_alike
from grasp_factory.writers.zarr.writer import COMMITTED, QUARANTINED

NO_LABEL = 255
"""Value of ``Selection.label`` for an episode that the label does not cover."""


class EpisodeSource(Protocol):
    """The part of a dataset that exports use; ``Dataset`` implements and describes it.

    A source must be picklable: worker processes open the store again. Reading raises
    ``StoreError`` where the store is damaged; an exporter does not catch it.
    """

    @property
    def path(self) -> Path:
        """Where the store is."""

    @property
    def config(self) -> FactoryConfig:
        """The settings that the episodes were made from."""

    @property
    def attributes(self) -> Mapping[str, Any]:
        """The root attributes of the store: robot, conventions, versions."""

    @property
    def features(self) -> Mapping[str, Field]:
        """The store's arrays by path: dimensions, type, unit, frame, words of coded values."""

    @property
    def labels(self) -> Sequence[str]:
        """Names of the labels that were added to the store's own, for ``label``."""

    @property
    def annotations(self) -> Mapping[int, Any]:
        """The annotations of episodes, by row; ``to_plain`` converts each to plain data."""

    def __getitem__(self, index: int) -> Episode:
        """Return the episode at a row."""

    def iter_episodes(
        self, indices: Iterable[int], series: Sequence[str] | None = None
    ) -> Iterator[Episode]:
        """Iterate over the episodes at rows, in their order; one is in memory.

        Only the time series at the paths ``series`` are needed; None for all.
        """

    def column(self, name: str) -> NDArray[Any]:
        """Return a column of all rows, (N, ...)."""

    def value(self, index: int, column: str) -> Any:
        """Return one column's value of one episode."""

    def values(self, indices: Iterable[int], column: str) -> NDArray[Any]:
        """Return one column's values of K episodes, (K, ...)."""

    def specs(self, indices: Iterable[int]) -> Iterator[EpisodeSpec]:
        """Iterate over the recipes of the episodes at rows, in their order."""

    def calibration(self, index: int, camera: str, frame: int) -> tuple[Array, Array]:
        """Return a camera's intrinsics (3, 3), pixels, and pose (4, 4) at frame 0 or 1.

        Of a real episode they are NaN where they were not measured.
        """

    def object_mesh(self, recipe: ObjectSpec) -> TriangleMesh:
        """Return the surface of an object of a recipe, in the object's own frame.

        Raises ``UsageError`` if this machine cannot build it.
        """

    def label_thresholds(self, name: str) -> Mapping[str, float | None]:
        """Return the thresholds that an added label was made with."""

    def label(self, name: str) -> NDArray[np.uint8]:
        """Return an added label's outcomes; rows added later have none, so it may be shorter."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Selection:
    """Episodes of one or several stores; the place of an episode is its number in the export."""

    sources: tuple[EpisodeSource, ...]
    store: NDArray[np.int64]
    """For each episode the position of its store in ``sources``, (n,), ascending."""
    row: NDArray[np.int64]
    """For each episode its row in that store, (n,)."""

    def __len__(self) -> int:
        """Return the number of episodes."""
        return len(self.row)

    def __getitem__(self, place: int) -> Episode:
        """Return an episode.

        Raises:
            StoreError: if it is damaged.
        """
        store, row = self.origin(place)
        return self.sources[store][row]

    def each(
        self, places: Sequence[int], series: Sequence[str] | None = None
    ) -> Iterator[tuple[int, Episode]]:
        """Yield numbers of episodes and the episodes, in this order; one is in memory.

        Args:
            places: the numbers.
            series: paths of the time series that are needed; None for all.

        Raises:
            StoreError: if one is damaged.
        """
        for source, run in self._runs(places):
            yield from zip(run.tolist(), source.iter_episodes(self.row[run], series), strict=True)

    def _runs(self, places: Sequence[int]) -> Iterator[tuple[EpisodeSource, NDArray[np.int64]]]:
        """Yield numbers of episodes as runs of the same store, each with this store."""
        numbers = np.asarray(places)
        changes = np.flatnonzero(np.diff(self.store[numbers])) + 1
        for run in np.split(numbers, changes):
            yield self.sources[self.store[run[0]]], run

    @property
    def config(self) -> FactoryConfig:
        """The first store's config; all stores have the same cameras, rates, robot and clutter."""
        return self.sources[0].config

    @property
    def fields(self) -> Mapping[str, Field]:
        """The arrays that all stores have, by path."""
        first, *others = (source.features for source in self.sources)
        return {path: row for path, row in first.items() if all(path in more for more in others)}

    def column(self, name: str) -> NDArray[Any]:
        """Return a column of the episodes, (n, ...)."""
        return self._of_each(lambda source: source.column(name))

    def label(self, name: str) -> NDArray[np.uint8]:
        """Return an added label's outcomes, (n,); 255 where a store or a row has none."""

        def label(source: EpisodeSource) -> NDArray[np.uint8]:
            outcomes = np.full(len(source.column("status")), NO_LABEL, np.uint8)
            there = source.label(name) if name in source.labels else ()
            outcomes[: len(there)] = there
            return outcomes

        return self._of_each(label)

    @property
    def quarantined(self) -> int:
        """Number of quarantined rows of the stores; they cannot be chosen."""
        status = np.concatenate([source.column("status") for source in self.sources])
        return int(np.count_nonzero(status == QUARANTINED))

    @property
    def is_real(self) -> NDArray[np.bool_]:
        """Which episodes were recorded with real devices, (n,)."""

        def is_real(source: EpisodeSource) -> NDArray[np.bool_]:
            if SOURCE not in source.features:
                return np.zeros(len(source.column("status")), np.bool_)
            real: NDArray[np.bool_] = source.column("source") == Source.REAL
            return real

        return self._of_each(is_real)

    def without_calibration(self, cameras: Sequence[str]) -> NDArray[np.bool_]:
        """Return for which episodes a camera has no intrinsics or no pose before, (n,).

        It was not measured, so these are real episodes.
        """
        lacks = np.zeros(len(self), np.bool_)
        for place in np.flatnonzero(self.is_real).tolist():
            store, row = self.origin(place)
            known = [self.sources[store].calibration(row, camera, 0) for camera in cameras]
            lacks[place] = any(np.isnan(values).any() for pair in known for values in pair)
        return lacks

    def _of_each(self, values_of: Callable[[EpisodeSource], NDArray[Any]]) -> NDArray[Any]:
        """Return the episodes' values from a function that returns a store's, (N, ...)."""
        stores = enumerate(self.sources)
        return np.concatenate([values_of(s)[self.row[self.store == k]] for k, s in stores])

    def only(self, keep: NDArray[np.bool_]) -> Selection:
        """Return the episodes for which ``keep``, (n,), is true."""
        return replace(self, store=self.store[keep], row=self.row[keep])

    def origin(self, place: int) -> tuple[int, int]:
        """Return the position of an episode's store in ``sources``, and its row there."""
        return int(self.store[place]), int(self.row[place])

    def value(self, place: int, column: str) -> Any:
        """Return one column's value of an episode; only its chunk is read."""
        store, row = self.origin(place)
        return self.sources[store].value(row, column)

    def values(self, places: Sequence[int], column: str) -> NDArray[Any]:
        """Return one column's values of K episodes, (K, ...); only their chunks are read."""
        parts = [source.values(self.row[run], column) for source, run in self._runs(places)]
        return np.concatenate(parts)

    def specs(self) -> Iterator[EpisodeSpec]:
        """Yield the recipe of each episode; no other array is read.

        Raises:
            StoreError: if one is damaged.
        """
        for source, run in self._runs(range(len(self))):
            yield from source.specs(self.row[run])

    def object_mesh(self, place: int, recipe: ObjectSpec) -> TriangleMesh:
        """Return the surface of an object of an episode's recipe, in the object's own frame.

        Raises:
            UsageError: if this machine cannot build it.
        """
        return self.sources[self.origin(place)[0]].object_mesh(recipe)


def select(chosen: Sequence[tuple[EpisodeSource, Sequence[int]]]) -> Selection:
    """Return the chosen rows of each store, in the order given.

    Args:
        chosen: stores, each with its rows that hold an episode, each row once.

    Raises:
        UsageError: if nothing is chosen, a store is named twice, a row is out of range, chosen
            twice or without an episode, or the stores differ in cameras, robot, rates, number of
            objects, sensors, or what they embed under one name.
    """
    _check_named_once([source.path for source, _ in chosen])
    chosen = [(source, rows) for source, rows in chosen if len(rows)] or list(chosen[:1])
    for source, rows in chosen:
        _check_rows(source, rows)
    sources = tuple(source for source, _ in chosen)
    check_alike([(source.path, source.config) for source in sources])
    counts = [len(rows) for _, rows in chosen]
    return Selection(
        sources=sources,
        store=np.repeat(np.arange(len(sources)), counts),
        row=np.concatenate([np.asarray(rows, np.int64) for _, rows in chosen]),
    )


def _check_named_once(stores: Sequence[Path]) -> None:
    """Check that no store is named twice, also by another path."""
    places = list(map(real_path, stores))
    for k, store in enumerate(stores):
        if places[k] in places[:k]:
            raise UsageError(f"{store}: the store is named twice; name each store once")


def _check_rows(source: EpisodeSource, rows: Sequence[int]) -> None:
    """Check that the rows are one or more, each once, and that all of them hold an episode."""
    status = source.column("status")
    if len(rows) == 0:
        raise UsageError(f"{source.path}: there are no episodes to export; choose some that exist")
    seen = set[int]()
    for row in rows:
        if not 0 <= row < len(status):
            raise UsageError(f"{source.path}: got row {row}, valid: 0 to {len(status) - 1}")
        if status[row] != COMMITTED:
            why = "quarantined" if status[row] == QUARANTINED else "missing"
            raise UsageError(f"{source.path}: row {row} has no episode: it is {why}; leave it out")
        if row in seen:
            raise UsageError(f"{source.path}: row {row} is named twice; name each row once")
        seen.add(row)
