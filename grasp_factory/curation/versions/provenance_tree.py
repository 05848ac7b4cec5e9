"""What a thing was made of, as a tree: a store, a snapshot, an export, a trained model."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from grasp_factory.core.json_text import parsed
from grasp_factory.core.limits import DOCUMENT
from grasp_factory.core.object_storage.address import is_remote, real_path
from grasp_factory.core.place import place_at
from grasp_factory.core.serialization import check
from grasp_factory.curation.versions.origin import (
    MOST_SOURCES,
    Origin,
    StoreState,
    read_origin,
    state_of,
)
from grasp_factory.dataset.snapshots.snapshot_folder import SHORT
from grasp_factory.errors import StoreError, StoreMismatchError, UsageError, shown
from grasp_factory.writers.exporters.export_record import RECORD
from grasp_factory.writers.zarr.header import read_attributes
from grasp_factory.writers.zarr.label_columns import added_labels

REPORT = "report.json"
"""File of ``train`` that names the store."""
DEEPEST = 32
"""Stores in a row, each made of the next, that a tree shows."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ProvenanceNode:
    """A thing, and what it was made of."""

    text: str
    made_of: tuple[ProvenanceNode, ...] = field(default_factory=tuple)

    def lines(self, depth: int = 0) -> Iterator[str]:
        """Yield a line for each thing, those that it was made of indented below it."""
        yield f"{'  ' * depth}{self.text}"
        for node in self.made_of:
            yield from node.lines(depth + 1)


def provenance_of(path: Path) -> ProvenanceNode:
    """Return what a thing was made of.

    Args:
        path: a store, the folder of an export, or the folder or a model of ``train``.

    Raises:
        UsageError: if nothing there says what it was made of.
        StoreError: if that is damaged.
    """
    if is_remote(path) or (path / "zarr.json").is_file():
        return _Stores().tree(path)
    if (path / RECORD).is_file():
        return _of_export(path)
    folder = path.parent if path.suffix == ".safetensors" else path
    if (folder / REPORT).is_file():
        return _of_training(folder)
    if not path.exists():
        raise StoreMismatchError(f"there is nothing at {path}")
    valid = "a store, an export, or the folder of a training"
    raise UsageError(f"{path} does not say what it was made of, valid: {valid}")


@dataclass(frozen=True, slots=True)
class _Stores:
    """Stores that are beside each other, each read once, however often one is named."""

    shown: set[Path] = field(default_factory=set)
    """Those whose sources are in the tree."""
    states: dict[Path, StoreState | None] = field(default_factory=dict)

    def tree(self, path: Path, depth: int = 0) -> ProvenanceNode:
        """Return the tree of a store, which is ``depth`` stores below the first one."""
        self.shown.add(real_path(path))
        state, origin = state_of(path), read_origin(path)
        nodes = [ProvenanceNode(text=f"labels/{name}, by relabel") for name in added_labels(path)]
        text = _state_text(state)
        if origin is None:
            nodes.append(ProvenanceNode(text=_generated(path)))
        elif origin.rows_sha256 != state.rows_sha256:
            nodes.append(
                ProvenanceNode(text=f"{origin.what}, and rows that were added or changed since")
            )
        else:
            nodes.append(self._of_origin(path, origin, depth))
        return ProvenanceNode(text=text, made_of=tuple(nodes))

    def _of_origin(self, path: Path, origin: Origin, depth: int) -> ProvenanceNode:
        """Return the sources of a store; those that are beside it with the same rows, as trees."""
        beside = [real_path(path).with_name(source.store) for source in origin.sources]
        pairs = zip(beside, origin.sources, strict=True)
        nodes = tuple(self._source(there, source, depth + 1) for there, source in pairs)
        text = f"{origin.what} by grasp-factory {origin.grasp_factory} of"
        return ProvenanceNode(text=text, made_of=nodes)

    def _source(self, beside: Path, source: StoreState, depth: int) -> ProvenanceNode:
        if beside not in self.shown and depth < DEEPEST:
            state = self._state(beside)
            if state is not None and state.rows_sha256 == source.rows_sha256:
                with contextlib.suppress(StoreError, UsageError):  # it may change meanwhile
                    return self.tree(beside, depth)
        return ProvenanceNode(text=_state_text(source))

    def _state(self, path: Path) -> StoreState | None:
        """Return the state of a store; None if it is not there any more, or damaged."""
        if path not in self.states:
            self.states[path] = None
            with contextlib.suppress(StoreError, UsageError):
                self.states[path] = state_of(path)
        return self.states[path]


def _state_text(state: StoreState) -> str:
    text = f"{state.store}: rows {state.rows_sha256[:SHORT]}"
    return f"{text}, snapshot {state.snapshot[:SHORT]}" if state.snapshot else text


def _generated(path: Path) -> str:
    attributes = read_attributes(path)
    versions = attributes["versions"]
    named = ", ".join(
        f"{name} {shown(versions.get(name))}" for name in ("grasp_factory", "pybullet")
    )
    seed, config = shown(attributes.get("seed")), attributes["config_sha256"][:SHORT]
    return f"generated: config {config}, seed {seed}, {named}"


def _of_export(path: Path) -> ProvenanceNode:
    record = _document(path, RECORD)
    nodes = [
        ProvenanceNode(text=f"{shown(store.get('name'))}: config {_config_of(store)}")
        for store in _stores(record.get("stores"), path)
    ]
    head = (
        f"{path}: export as {shown(record.get('format'))}, {shown(record.get('episodes'))} episodes"
    )
    return ProvenanceNode(text=f"{head}, each with its checksum; of", made_of=tuple(nodes))


def _stores(named: Any, path: Path) -> list[Mapping[str, Any]]:
    """Return what a file says of one or more stores.

    Raises:
        ConfigError: if they are too many.
    """
    stores = named if isinstance(named, list) else [named]
    check(len(stores) <= MOST_SOURCES, f"stores of {path}", len(stores), f"up to {MOST_SOURCES}")
    return [store for store in stores if isinstance(store, Mapping)]


def _config_of(store: Mapping[str, Any]) -> str:
    attributes = store.get("attributes")
    found = attributes.get("config_sha256") if isinstance(attributes, Mapping) else None
    return str(found)[:SHORT]


def _of_training(folder: Path) -> ProvenanceNode:
    report = _document(folder, REPORT)
    nodes = []
    for key in ("store", "test"):
        for store in _stores(report.get(key), folder):
            keys = ("config_sha256", "rows_sha256", "snapshot")
            facts = ", ".join(f"{k.partition('_')[0]} {str(store[k])[:SHORT]}" for k in keys
                              if store.get(k))  # fmt: skip
            nodes.append(ProvenanceNode(text=f"{key} {shown(store.get('path'))}: {facts}"))
    text = f"{folder}: models of grasp-factory {shown(report.get('grasp_factory'))}, trained on"
    return ProvenanceNode(text=text, made_of=tuple(nodes))


def _document(folder: Path, name: str) -> dict[str, Any]:
    file = place_at(folder.resolve()) / name
    try:
        found = parsed(file.read_bytes(DOCUMENT))
    except (OSError, ValueError) as error:
        raise StoreError(f"{file} cannot be read: {error}") from None
    if not isinstance(found, dict):
        raise StoreError(f"{file} is damaged: it is no mapping")
    return found
