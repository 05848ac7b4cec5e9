"""Reading a store for the index: which blocks exist, and the rows of each block."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator, Mapping, Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from grasp_factory.core import schema
from grasp_factory.core.enums import Outcome
from grasp_factory.core.place import place_of
from grasp_factory.core.place_tree import file_facts
from grasp_factory.dataset.index.columns import OF_ROWS, STATUSES, STORED, stored_name
from grasp_factory.dataset.index.words import lighting, scenario, sensor_setup
from grasp_factory.errors import LimitError, StoreError
from grasp_factory.writers.zarr.columns import Columns
from grasp_factory.writers.zarr.layout import block_number
from grasp_factory.writers.zarr.writer import COMMITTED, MISSING, QUARANTINED

TASK = "grasp"
MARKERS = schema.STATUS.path
CHUNK = 64
"""Maximum number of blocks that are read together."""
_LIGHT = re.compile(r'"light":(\{[^{}]*\})')
_NONE: Mapping[str, tuple[Any, ...]] = {"quality": (0,), "seed": (-1,), "index": (-1,)}
"""Integers that mean "no value", by column."""


class IndexSource:
    """A store, opened to be indexed.

    Attributes:
        path: the absolute path of the store.
        root: a text that changes when another store replaces this one.
    """

    def __init__(self, path: Path) -> None:
        """Open the store.

        Raises:
            StoreMismatchError: if there is no store.
            StoreError: if it is damaged.
        """
        self.path = path
        self._columns = Columns.open(path)
        facts = (self._columns.place / "zarr.json").stat()
        self.root = f"{facts.st_ctime_ns} {facts.st_ino}"
        self._config = self._columns.config
        fields = {row.path: row for row in schema.expand(self._config)}
        there = self._columns.names
        self._fields = {
            name: fields[row.path]
            for name, row in STORED.items()
            if row.path in fields and stored_name(row) in there
        }
        self._files = [
            (self._columns.place / row.path, ".0" * len(row.dims), row.is_video)
            for row in schema.expand(self._config)
        ]

    @property
    def facts(self) -> dict[str, str]:
        """The values that all rows of the store share, by column."""
        return {
            "scenario": scenario(self._config),
            "task_type": TASK,
            "extracted_path": str(self.path),
            "sensor_setup": json.dumps(sensor_setup(self._config), sort_keys=True),
        }

    def blocks(self) -> dict[int, str]:
        """Return the blocks that exist, by number, each with a text that changes when it is remade.

        Raises:
            StoreError: if the directory of their markers cannot be read.
        """
        last = -(-self._columns.length // self._config.block_size)
        out = {}
        try:
            for name, facts in file_facts(self._columns.place / MARKERS):
                number = block_number(name, schema.STATUS)
                if number is not None and number < last:
                    out[number] = f"{facts.st_mtime_ns} {facts.st_ctime_ns} {facts.st_ino}"
        except OSError as error:
            what = f"{self.path}: {MARKERS} cannot be read"
            raise StoreError(f"{what}: {error.strerror}") from None
        return out

    def rows(self, blocks: Mapping[int, str]) -> Iterator[list[tuple[Any, ...]]]:
        """Yield the rows of some blocks, as values of ``OF_ROWS``, without annotations.

        Values from annotations and the store's number are None. Missing rows are left out.
        """
        whole: Mapping[str, NDArray[Any]] = {}
        if len(blocks) > CHUNK:  # packed segments make whole columns quick to read
            whole = self._whole()
        for chunk in _runs(sorted(blocks)):
            yield self._chunk(chunk, {block: blocks[block] for block in chunk}, whole)

    def episodes(self, blocks: Mapping[int, str]) -> int:
        """Return how many rows some blocks have, including missing rows."""
        return sum(stop - start for start, stop in map(self._columns.rows, blocks))

    def span(self, block: int) -> tuple[int, int]:
        """Return the first row of a block, and the one after its last."""
        return self._columns.rows(block)

    def _whole(self) -> Mapping[str, NDArray[Any]]:
        try:
            return self._columns.read("status", *map(stored_name, self._fields.values()))
        except LimitError:
            raise
        except StoreError:  # reading block by block finds what is damaged
            return {}

    def _chunk(
        self, chunk: Sequence[int], markers: Mapping[int, str], whole: Mapping[str, NDArray[Any]]
    ) -> list[tuple[Any, ...]]:
        start, stop = self._columns.rows(chunk[0])[0], self._columns.rows(chunk[-1])[1]

        def read(name: str) -> NDArray[Any]:
            if name in whole:
                return whole[name][start:stop]
            return text.count(self._columns.read_rows(name, start, stop))

        text = self._columns.text_budget()
        try:
            return list(self._derived(start, stop, read, markers))
        except LimitError:
            raise
        except StoreError as error:
            if len(chunk) > 1:
                return [
                    row
                    for block in chunk
                    for row in self._chunk([block], {block: markers[block]}, {})
                ]
            return self._broken(start, stop, markers[chunk[0]], str(error))

    def _derived(
        self, start: int, stop: int, read: Any, markers: Mapping[int, str]
    ) -> Iterator[tuple[Any, ...]]:
        status = read("status")
        if (status > QUARANTINED).any():
            raise StoreError(f"{schema.STATUS.path} has values that no row has")
        columns = {name: _plain(row, read(stored_name(row))) for name, row in self._fields.items()}
        columns["checksum"] = read("checksum").tolist()
        specs = read("spec").tolist()
        rows = np.arange(start, stop)
        blocks = rows // self._config.block_size
        errors = read("error").tolist() if (status == QUARANTINED).any() else [""] * len(rows)
        of_block = {b: (_date(marker), self._megabytes(b)) for b, marker in markers.items()}
        names = list(columns)
        for k, values in enumerate(zip(*columns.values(), strict=True)):
            if status[k] == MISSING:
                continue
            row = dict(zip(names, values, strict=True))
            if status[k] == COMMITTED:
                row |= self._of_committed(row, specs[k])
            else:
                row = _of_recipe(specs[k])
                row["error"] = errors[k] or None
            row["status"] = STATUSES[int(status[k]) - 1]
            row["row"] = start + k
            row["operator"] = row.get("recorded_operator") or row.get("policy")
            row["created_at"], row["file_size_mb"] = of_block[int(blocks[k])]
            yield tuple(row.get(name) for name in OF_ROWS)

    def _of_committed(self, row: Mapping[str, Any], spec: str) -> dict[str, Any]:
        out: dict[str, Any] = {"lighting": _lighting(spec), "data_quality": row.get("quality")}
        if row["n_steps"] is not None:
            steps = round(row["n_steps"] / self._config.record_hz, 6)
            out["duration"] = row.get("recorded_duration") or steps
        if row["outcome"] != Outcome.COLLISION.name.lower():
            out["collision_body"] = None
        if row.get("seed") is None or row.get("index") is None:
            recipe = _of_recipe(spec)
            out |= {key: recipe.get(key) for key in ("seed", "index")}
        out["checksum"] = row["checksum"] or None
        return out

    def _megabytes(self, block: int) -> float:
        """Return a row's share of the size of its block's files, in MB."""
        start, stop = self._columns.rows(block)
        total = 0
        for folder, tail, by_episode in self._files:
            for number in range(start, stop) if by_episode else (block,):
                try:
                    total += folder.size_of(f"{number}{tail}")
                except OSError:  # an array that an older store lacks
                    continue
        return round(total / (stop - start) / 1e6, 6)

    def _broken(self, start: int, stop: int, marker: str, why: str) -> list[tuple[Any, ...]]:
        """Return the rows of a block that cannot be read, with the reason as their error."""
        date = _date(marker)
        known = {"status": STATUSES[0], "created_at": date, "error": why}
        return [tuple((known | {"row": row}).get(n) for n in OF_ROWS) for row in range(start, stop)]


def state_of(store: Path) -> str | None:
    """Return a text that changes when the indexed data of a store changes, except annotations.

    It has the times when files changed on this machine. Times of modification come with an archive:
    a stranger's file could have those of an honest one.

    Return None if the store changed so recently that the file system may assign the same time to
    another change.

    Raises:
        StoreError: if the store is gone.
    """
    now = datetime.now(UTC).timestamp()
    parts, newest = [], 0.0
    try:
        place = place_of(store)
        for name in ("zarr.json", f"{MARKERS}/zarr.json", MARKERS):
            facts = (place / name).stat()
            parts.append(f"{facts.st_ctime_ns} {facts.st_ino}")
            newest = max(newest, facts.st_ctime)
    except OSError as error:
        raise StoreError(f"there is no store at {store} any more: {error.strerror}") from None
    return "; ".join(parts) if now - newest > SETTLED_S else None


SETTLED_S = 2.0


def _runs(blocks: Sequence[int]) -> Iterator[list[int]]:
    """Yield runs of consecutive blocks, up to ``CHUNK`` blocks each."""
    run: list[int] = []
    for block in blocks:
        if run and (block != run[-1] + 1 or len(run) == CHUNK):
            yield run
            run = []
        run.append(block)
    if run:
        yield run


def _plain(field: schema.Field, values: NDArray[Any]) -> list[Any]:
    """Return a column's values as Python values; None where a row has no value."""
    if field.names:
        words = dict(enumerate(field.names))
        return [words.get(code) for code in values.tolist()]
    plain: list[Any] = values.tolist()
    if field.dtype == "string":
        return [text or None for text in plain]
    if values.dtype.kind == "f":
        fine = np.isfinite(values)
        return (
            plain if fine.all() else [v if ok else None for v, ok in zip(plain, fine, strict=True)]
        )
    nothing = _NONE.get(field.path.removeprefix("episodes/"), ())
    return [None if value in nothing else value for value in plain] if nothing else plain


def _date(marker: str) -> str:
    seconds = int(marker.partition(" ")[0]) // 10**9
    return datetime.fromtimestamp(seconds, UTC).strftime("%Y-%m-%dT%H:%M:%SZ")


def _lighting(spec: str) -> str | None:
    """Return the word for the light of a recipe; None if it cannot be read."""
    found = _LIGHT.search(spec)
    return lighting(found[1]) if found else None


def _whole(value: Any) -> int | None:
    """Return an integer; None for one that SQLite cannot store."""
    number = int(value)
    return number if abs(number) < 2**63 else None


def _of_recipe(spec: str) -> dict[str, Any]:
    """Return the values, by column, that the recipe of a row contains."""
    try:
        plain = json.loads(spec)
        target = plain["objects"][0]
        return {
            "seed": _whole(plain["seed"]),
            "index": _whole(plain["index"]),
            "policy": str(plain["policy"]),
            "object_id": str(target["object_id"]),
            "object_set": str(target["object_set"]),
            "object_family": str(target["family"]),
            "split": str(target["split"]),
            "object_mass": None if target["mass"] is None else float(target["mass"]),
            "lighting": _lighting(spec),
        }
    except (ValueError, TypeError, LookupError, OverflowError, RecursionError):
        return {}
