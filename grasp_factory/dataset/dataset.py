"""Reading a store: open it, choose episodes, and get the records that were written."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from functools import partial
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self, overload

import numpy as np
import zarr
from numpy.typing import NDArray

from grasp_factory.core.episode import Episode, ObjectSpec
from grasp_factory.core.object_storage.address import store_path
from grasp_factory.core.optional import require
from grasp_factory.core.triangle_mesh import TriangleMesh
from grasp_factory.dataset.annotated_episodes import AnnotatedEpisodes
from grasp_factory.dataset.dataset_display import dataset_html, dataset_text
from grasp_factory.dataset.episode_reader import Episodes
from grasp_factory.dataset.features import Features
from grasp_factory.dataset.joined_stores import opened_together
from grasp_factory.dataset.object_meshes import recipe_mesh
from grasp_factory.dataset.row_lookup import RowIndex, chosen_rows
from grasp_factory.dataset.sensor_reader import Readings
from grasp_factory.signals.noise import EpisodeNoise, SensorNoise, named_noise
from grasp_factory.writers.zarr.array_reader import by_block
from grasp_factory.writers.zarr.label_columns import added_columns

if TYPE_CHECKING:
    import pandas

    from grasp_factory.writers.exporters.exporting import Exported


class Dataset(AnnotatedEpisodes):
    """The episodes of a store, or of a view. Opening or reading never runs code from the store.

    ``where``, ``split``, ``filter``, ``select``, ``shuffle``, ``balanced``, ``tagged`` and
    ``ds[3:10]`` return views: datasets of some of the rows. Wherever a method takes an index, it is
    the index in this dataset; ``indices`` has the rows of the store.

    Attributes:
        paths, starts: each store, and its first row; then the number of all rows.
        config: the configuration that it was made from.
        attributes: all root attributes: seed, versions, conventions, ...
        noise: the noise that is added to what is read.
    """

    def __init__(
        self,
        path: Path | str | Sequence[Path | str],
        noise: str | SensorNoise | None = None,
        noise_seed: int = 0,
        *,
        checked: bool = False,
    ) -> None:
        """Open the store at ``path``, or several as one.

        Args:
            path: path or address of a store, or several, alike but for seed and block size.
            noise: the sensor noise that is added to episodes, images and series when they are
                read, or its name in ``noise.NOISE``; columns and the store itself stay clean.
            noise_seed: the same seed yields the same noise.
            checked: compare values of committed rows with their checksums as they are read; a
                mismatch is a StoreError that names episode and array.

        Raises:
            StoreMismatchError: if there is no store, or it has a newer version.
            StoreError: if the store is damaged.
            UsageError: for an invalid noise or seed, or for stores of different kinds.
        """
        given = [path] if isinstance(path, str | Path) else path
        self.paths = tuple(map(store_path, given))
        self.noise = EpisodeNoise(named_noise(noise), noise_seed)
        found = opened_together(self.paths, checked=checked)
        store, self.starts = found.store, found.starts
        self.config, self.attributes = store.config, store.attributes
        self._arrays, self._is_checked = store.arrays, checked
        parts = (found.name, store.config, store.arrays, store.fields, self.noise)
        super().__init__(
            found.columns,
            Features(store.fields, {p: array.zarr.shape[1:] for p, array in store.arrays.items()}),
            RowIndex(found.name, store.arrays, store.config.block_size),
            Readings(*parts),
            found.annotations,
        )
        self._episodes = Episodes(*parts)

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickle as the arguments and the chosen rows; another process opens the store again."""
        again = partial(_again, checked=self._is_checked)
        return again, (self.paths, self.noise.noise, self.noise.seed, self._rows.chosen)

    def __repr__(self) -> str:
        return dataset_text(self)

    def _repr_html_(self) -> str:
        """Return the first episodes and the outcomes for a notebook."""
        return dataset_html(self)

    @overload
    def __getitem__(self, index: int) -> Episode: ...

    @overload
    def __getitem__(self, index: str) -> NDArray[Any]: ...

    @overload
    def __getitem__(self, index: slice | Sequence[int] | NDArray[Any]) -> Self: ...

    def __getitem__(self, index: Any) -> Episode | NDArray[Any] | Self:
        """Return an episode by its index, a column by its name, or a view of several rows.

        A column (N, ...) has words for coded values, as in ``where`` and ``column(...,
        names=True)``. For what several rows may be, see ``select``. A negative index counts from
        the end.

        Raises:
            IndexError: naming the valid range.
            UnknownNameError: listing the columns.
            TypeError: for anything else.
            StoreError: if a row is missing, quarantined or damaged.
        """
        if isinstance(index, str):
            return self.column(index, names=True)
        if isinstance(index, slice | list | range | np.ndarray):
            return self.select(index)
        return self._episodes.one(self._rows.committed(index))

    def __iter__(self) -> Iterator[Episode]:
        """Iterate over the episodes in their order; see ``iter_episodes``."""
        return self._episodes.of_blocks(self._rows.rows_at(self.committed))

    def iter_episodes(
        self, indices: Iterable[int], series: Iterable[str] | None = None
    ) -> Iterator[Episode]:
        """Iterate over episodes in the order of their indices.

        Neighbours of a block are read together, but for their images: those of one episode are in
        memory.

        Args:
            indices: The episodes.
            series: Paths of the time series that are needed, such as ``streams/tcp_pose``; None for
                all. Of the others, the episodes have ``timestamp`` alone. With noise all are read.

        Raises:
            UnknownNameError: for a time series that does not exist.
            TypeError, IndexError, StoreError: as for ``dataset[indices]``.
        """
        return self._episodes.of_blocks(self._rows.several(indices), series)

    def iter_blocks(
        self, indices: Iterable[int] | None = None
    ) -> Iterator[tuple[NDArray[np.int64], list[Episode]]]:
        """Iterate over (indices, episodes) of each block; one block at a time is in memory.

        Consecutive rows are read together. Only the requested episodes are read, each once.

        Args:
            indices: The episodes to read; None for all. Blocks are yielded in the order in which
                the indices first name them, and the episodes of a block in the order given. An
                index that is given twice is yielded twice.

        Raises:
            TypeError, IndexError, StoreError: as for ``dataset[indices]``.
        """
        places = self.committed if indices is None else self._rows.places(indices)
        rows = self._rows.rows_at(places) if indices is None else self._rows.several(places)
        return (
            (places[mine], self._episodes.several(rows[mine]))
            for mine in by_block(rows, self.config.block_size)
        )

    def object_mesh(self, recipe: ObjectSpec) -> TriangleMesh:
        """Return the surface of an object of a recipe of this store, in the object's own frame.

        Raises:
            UsageError: if this machine cannot build it: the message says what to install or import.
            StoreError: if the objects that the store contains are damaged or too large.
        """
        return recipe_mesh(self.paths[0], self.config, recipe)

    def value(self, index: int, column: str) -> Any:
        """Return one column's value of one episode, a scalar, string or array; see ``values``."""
        self._check_column(column)
        i = self._rows.committed(index)
        return self._arrays[f"episodes/{column}"].read(i, i + 1)[0]

    def values(self, indices: Iterable[int], column: str) -> NDArray[Any]:
        """Return one column's values of K episodes, (K, ...); only their blocks are read.

        Raises:
            UnknownNameError: listing the columns.
            TypeError, IndexError, StoreError: as for ``dataset[indices]``.
        """
        self._check_column(column)
        rows = self._rows.several(indices)
        return self._arrays[f"episodes/{column}"].gather(rows, self.config.block_size)

    def arrays(self) -> dict[str, zarr.Array[Any]]:
        """Return every array of the whole store by its path, including added labels."""
        own = {path: array.zarr for path, array in self._arrays.items()}
        return {**own, **added_columns(self.path)}

    def to_pandas(self, columns: Sequence[str] | None = None) -> pandas.DataFrame:
        """Return columns of the episodes as a table; its index, ``row``, is the store's row.

        Coded values are categories. A column with several values a row has arrays in its cells.

        Args:
            columns: Names of columns; None for all but the recipe and what ``verify`` needs.

        Raises:
            UnknownNameError: for an unknown column.
            MissingLibraryError: without pandas; the message says how to install it.
            StoreError: if a column is damaged.
        """
        from grasp_factory.dataset.pandas_table import pandas_table  # noqa: PLC0415

        return pandas_table(self, columns)

    def to_torch(self, **settings: Any) -> Any:
        """Return the episodes with a grasp as ``grasp_factory.torch.GraspDataset``.

        Args:
            **settings: its arguments, such as ``uses``, ``noise`` and ``mirror_seed``.

        Raises:
            MissingLibraryError: without PyTorch; the message says how to install it.
            UsageError: for invalid settings, or if no episode can be used.
        """
        require("torch", extra="torch")
        # Examples are made in a room that imports this one, so the name is looked up when it is
        # used, as in ``grasp_factory.__getattr__``.
        return import_module("grasp_factory.torch").GraspDataset(self, **settings)

    def export(
        self,
        to: str,
        out: Path | str,
        indices: Iterable[int] | None = None,
        *,
        workers: int = 1,
        **settings: Any,
    ) -> Exported:
        """Write episodes in the format of another tool to the folder ``out``.

        Args:
            to: the format; ``grasp-factory export --list`` lists all of them.
            out: the folder to create; it must not exist.
            indices: the episodes, in the order of the export, or a mask of truth values, one for
                each row; None for all episodes, in their order. Those of one store are together.
            workers: number of processes; the files do not depend on it.
            **settings: options of the format.

        Raises:
            UnknownNameError: for an unknown format.
            UsageError: for a place that is taken, a missing library, indices of no episodes, or
                episodes that the format cannot hold.
            ConfigError: for an invalid setting.
            StoreError: if the store is damaged, or the disk fails or is full.
        """
        from grasp_factory.dataset.store_rows import store_rows  # noqa: PLC0415
        from grasp_factory.writers.exporters import exporter_named  # noqa: PLC0415
        from grasp_factory.writers.exporters.exporting import run_export  # noqa: PLC0415

        exporter = exporter_named(to)
        chosen = self.committed if indices is None else chosen_rows(indices, len(self))
        rows = store_rows(self, self._rows.rows_at(chosen), checked=self._is_checked)
        return run_export(exporter, rows, Path(out), settings, workers=workers)

    def verify(self, index: int) -> bool:
        """Return whether an episode's values match its checksum.

        Raises:
            IndexError: naming the valid range.
            StoreError: if the row is missing or quarantined.
        """
        return self._episodes.is_whole(self._rows.committed(index))


def _again(
    path: tuple[Path, ...],
    noise: SensorNoise | None,
    noise_seed: int,
    rows: NDArray[np.int64] | None,
    *,
    checked: bool,
) -> Dataset:
    """Return a dataset that was pickled."""
    whole = Dataset(path, noise, noise_seed, checked=checked)
    return whole if rows is None else whole._view(rows)
