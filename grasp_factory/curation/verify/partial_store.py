"""A store opened array by array, so that damaged arrays do not hide the others."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from grasp_factory.core import schema
from grasp_factory.core.config.factory_config import FactoryConfig
from grasp_factory.core.place import Place
from grasp_factory.core.schema import Field
from grasp_factory.curation.verify.documents import array_documents, length_problems
from grasp_factory.curation.verify.foreign_chunks import is_rewritten
from grasp_factory.curation.verify.length import most_rows, number_of_rows
from grasp_factory.curation.verify.problems import Problem
from grasp_factory.dataset.row_integrity import digested_paths
from grasp_factory.errors import StoreError
from grasp_factory.writers.zarr.array_layout import stored
from grasp_factory.writers.zarr.array_reader import StoredArray
from grasp_factory.writers.zarr.budgets import check_arrays
from grasp_factory.writers.zarr.header import SOURCES, open_array, open_store, place_in
from grasp_factory.writers.zarr.made_of_export import arrays_not_held


@dataclass(frozen=True, slots=True, kw_only=True)
class PartialStore:
    """The readable parts of a store.

    Attributes:
        path: the store's path.
        place: its directory.
        config: the config that it was made from.
        attributes: the root's attributes.
        rows: number of rows of every array.
        fields: by path; the fields that the store has, damaged or not.
        arrays: by path; the arrays with undamaged metadata, and those of ``rewritten``.
        rewritten: paths of arrays that another program may have rewritten; their rows are checked.
    """

    path: Path
    place: Place
    config: FactoryConfig
    attributes: Mapping[str, Any]
    rows: int
    fields: Mapping[str, Field]
    arrays: Mapping[str, StoredArray]
    rewritten: frozenset[str]

    @property
    def is_collected(self) -> bool:
        """Whether it was merged or split, so that rows may have recipes of any index."""
        return SOURCES in self.attributes

    @property
    def source_seeds(self) -> set[int]:
        """The seeds of its rows, if it was merged or split, as far as they can be read."""
        sources = self.attributes[SOURCES]
        told = sources if isinstance(sources, list) else ()
        seeds = (source.get("seed") for source in told if isinstance(source, dict))
        return {seed for seed in seeds if isinstance(seed, int)}

    @property
    def lacks_arrays(self) -> bool:
        """Whether it was made of an export that did not hold every array."""
        return bool(arrays_not_held(self.attributes))

    @property
    def digested(self) -> tuple[str, ...]:
        """Paths in the order of ``episodes/array_crc32c``; empty if that array is damaged."""
        return digested_paths(self.arrays)

    @property
    def blocks(self) -> int:
        """Number of blocks; the last one may be short."""
        return -(-self.rows // self.config.block_size)

    def rows_of(self, block: int) -> range:
        """Return the rows of a block."""
        start = block * self.config.block_size
        return range(start, min(start + self.config.block_size, self.rows))


def open_pieces(path: Path) -> tuple[PartialStore, list[Problem]]:
    """Open the readable parts of the store at ``path``, whose root is intact.

    Returns:
        The pieces, and a problem for each array whose metadata is damaged.

    Raises:
        StoreError: if the store cannot be opened at all.
    """
    root, config = open_store(path, mode="r")
    fields = {row.path: row for row in schema.expand(config)}
    problems: list[Problem] = []
    whole: dict[str, Any] = {}
    known: dict[str, Field] = {}
    rewritten: set[str] = set()
    store = place_in(root)
    found = list(array_documents(store, config))
    for name, document, fault in found:
        known[name] = fields[name]
        if not fault or is_rewritten(document, fields[name], config):
            whole[name] = document
            rewritten |= {name} if fault else set()
        else:
            problems.append(Problem(episode=None, array=name, what=fault))
    told = most_rows(whole.values())
    told = most_rows(document for _, document, _ in found) if told is None else told
    rows = number_of_rows(store, config, known, told)
    short = length_problems(whole, rows)
    problems += short
    opened = {}
    for name in sorted(set(whole) - {problem.array for problem in short}):
        try:
            opened[name] = open_array(root, name)
        except StoreError as error:
            problems.append(Problem(episode=None, array=name, what=str(error)))
    check_arrays(store, config, opened.values())
    arrays = {name: stored(array) for name, array in opened.items()}
    pieces = PartialStore(
        path=path,
        place=store,
        config=config,
        attributes=root.attrs.asdict(),
        rows=rows,
        fields=known,
        arrays=arrays,
        rewritten=frozenset(rewritten & set(arrays)),
    )
    return pieces, problems
