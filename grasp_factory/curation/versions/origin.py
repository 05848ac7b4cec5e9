"""What a merged, split or packed store was made of: ``NAME.origin.json`` beside it.

It is not in the store, whose bytes do not depend on the names of its sources, nor on snapshots.
"""

from __future__ import annotations

import json
import warnings
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

from grasp_factory import __version__
from grasp_factory.core.json_text import parsed
from grasp_factory.core.limits import DOCUMENT
from grasp_factory.core.object_storage.address import store_path
from grasp_factory.core.place import Place, place_at
from grasp_factory.core.serialization import check, from_plain, to_plain
from grasp_factory.dataset.snapshots import SnapshotFolder
from grasp_factory.dataset.snapshots.snapshot import is_sha256
from grasp_factory.dataset.snapshots.version import rows_sha256
from grasp_factory.errors import ConfigError, GraspFactoryWarning, StoreError
from grasp_factory.writers.zarr.files import locate
from grasp_factory.writers.zarr.header import read_attributes

SUFFIX = ".origin.json"
MOST_SOURCES = 10_000
_LONGEST_NAME = 255


@dataclass(frozen=True, slots=True, kw_only=True)
class StoreState:
    """A store at the moment when something was made of it."""

    store: str
    """Name of its folder."""
    config_sha256: str
    rows_sha256: str
    """SHA-256 that names recipe, status and checksum of every row."""
    snapshot: str
    """Id of its newest snapshot with these rows; empty if there is none."""

    def __post_init__(self) -> None:
        check(0 < len(self.store) <= _LONGEST_NAME, "store", self.store, "a name")
        is_name = self.store not in (".", "..") and not set(self.store) & set("/\0")
        check(is_name, "store", self.store, "the name of a folder")
        for key in ("config_sha256", "rows_sha256"):
            check(is_sha256(getattr(self, key)), key, getattr(self, key), "a SHA-256")
        check(not self.snapshot or is_sha256(self.snapshot), "snapshot", self.snapshot, "an id")


@dataclass(frozen=True, slots=True, kw_only=True)
class Origin:
    """What a store was made of, and by which command."""

    what: str
    """merge, split or pack."""
    grasp_factory: str
    rows_sha256: str
    """Of the store that was made."""
    sources: tuple[StoreState, ...]

    def __post_init__(self) -> None:
        valid = ("merge", "split", "pack")
        check(self.what in valid, "what", self.what, ", ".join(valid))
        check(len(self.grasp_factory) <= _LONGEST_NAME, "grasp_factory", "a long text", "a version")
        check(is_sha256(self.rows_sha256), "rows_sha256", self.rows_sha256, "a SHA-256")
        most = f"up to {MOST_SOURCES}"
        check(len(self.sources) <= MOST_SOURCES, "sources", len(self.sources), most)


def state_of(path: Path) -> StoreState:
    """Return the state of the store at ``path``.

    Raises:
        StoreMismatchError: if there is no store.
        StoreError: if its columns, or one of its snapshots, are damaged.
    """
    found = rows_sha256(path)
    history = SnapshotFolder.of(path).history()
    same = (name for name, snapshot in history if snapshot.contents.rows_sha256 == found)
    return StoreState(
        store=locate(path).name,
        config_sha256=read_attributes(path)["config_sha256"],
        rows_sha256=found,
        snapshot=next(same, ""),
    )


def states_of(paths: Iterable[Path]) -> tuple[StoreState, ...]:
    """Return the states of several stores; of a damaged one, none, after a warning."""
    out = []
    for path in paths:
        try:
            out.append(state_of(path))
        except (StoreError, ConfigError) as error:
            text = f"the origin does not name {path}: {error}"
            warnings.warn(text, GraspFactoryWarning, stacklevel=2)
    return tuple(out)


def write_origin(store: Path | str, what: str, sources: Sequence[StoreState]) -> None:
    """Write beside a new store what it was made of; warn if that fails: the store is complete.

    Another file of this name is left alone.
    """
    path = store_path(store)
    try:
        file = _file(path)
        if file.exists():
            read_origin(path)  # of a store that is gone
        origin = Origin(
            what=what,
            grasp_factory=__version__,
            rows_sha256=rows_sha256(path),
            sources=tuple(sources),
        )
        text = json.dumps(to_plain(origin), indent=2) + "\n"
        file.write(text.encode(), durable=True)
    except (StoreError, OSError) as error:
        text = f"{path} has no {SUFFIX} beside it: {error}"
        warnings.warn(text, GraspFactoryWarning, stacklevel=2)


def read_origin(store: Path) -> Origin | None:
    """Return what a store was made of; None if no file beside it says that.

    Raises:
        StoreError: if the file is damaged, or another one.
    """
    file = _file(store)
    try:
        return from_plain(Origin, parsed(file.read_bytes(DOCUMENT)))
    except FileNotFoundError:
        return None
    except (ConfigError, ValueError) as error:
        raise StoreError(f"{file} does not say what a store was made of: {error}") from None
    except OSError as error:
        raise StoreError(f"{file} cannot be read: {error.strerror}") from None


def _file(store: Path) -> Place:
    whole = locate(store)
    return place_at(whole.with_name(whole.name + SUFFIX))
