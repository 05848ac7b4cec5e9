"""Opening an up-to-date index, from the paths of a command line."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

from grasp_factory.core.cache import cache_dir, digest
from grasp_factory.dataset.index.building import build, default_path, places
from grasp_factory.dataset.index.database import VERSION, DamagedIndexError, version_of
from grasp_factory.dataset.index.handle import Index
from grasp_factory.errors import UsageError


def fresh(
    paths: Sequence[Path],
    index: Path | None = None,
    on_start: Callable[[int], None] = lambda rows: None,
    on_row: Callable[[int], None] = lambda row: None,
) -> Index:
    """Open the index of some stores and update it; it is built if there is none.

    Args:
        paths: Stores, or one index file.
        index: The path of the index. None for the default: next to the store, or in the cache for
            several stores.
        on_start: Called with the number of rows if the index is built; see ``build``.
        on_row: Called after each of these rows.

    Raises:
        StoreMismatchError: if a path is neither a store nor an index.
        StoreError: if a store is gone or damaged.
        UsageError: if the index cannot be written, or if its path is another file or the
            index of other stores.
    """
    stores = places(paths)
    if len(stores) == 1 and stores[0].is_file():
        if index is not None:
            raise UsageError(f"{paths[0]} is a file: --index goes with stores only")
        return _of_file(stores[0], on_start, on_row)
    place = _default(stores) if index is None else index
    version = version_of(place)
    opened = Index(place) if version == VERSION else None
    if opened is not None:
        try:
            there = {store.path for store in opened.stores}
            if there == set(stores):
                opened.refresh()
                return opened
        except DamagedIndexError:
            there = set(stores)  # an index is derived from its stores: build it again
        except BaseException:
            opened.close()
            raise
        opened.close()
        if index is not None and there != set(stores):
            names = ", ".join(map(str, sorted(there)))
            raise UsageError(
                f"{index} is the index of {names}; give it in place of the stores, or name another"
                f" file; grasp-factory index ... --out {index} builds it again"
            )
    build(stores, place, on_start, on_row)
    return Index(place)


def _default(stores: Sequence[Path]) -> Path:
    if len(stores) == 1:
        return default_path(stores[0])
    name = digest("\n".join(map(str, stores)).encode())
    folder = cache_dir() / "indexes"
    folder.mkdir(parents=True, exist_ok=True)
    return folder / f"{name}.sqlite"


def _of_file(file: Path, on_start: Callable[[int], None], on_row: Callable[[int], None]) -> Index:
    version = version_of(file)
    if version != VERSION:
        raise UsageError(
            f"index {file} was made by another version of grasp-factory; build it again:"
            f" grasp-factory index STORE... --out {file}"
        )
    opened = Index(file)
    try:
        opened.refresh()
    except BaseException:
        opened.close()
        raise
    return opened
