"""Comparing two versions of a store, episode by episode."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from grasp_factory.curation.versions.difference import Difference, RowNames
from grasp_factory.dataset.snapshots import StoreContents, Version, segments
from grasp_factory.dataset.snapshots.segments import ROW
from grasp_factory.errors import StoreError, shown
from grasp_factory.writers.zarr.writer import COMMITTED

_Integers = NDArray[np.int64]
_MOST_SETTINGS = 50


@dataclass(frozen=True, slots=True)
class _Side:
    """The rows of a version that the other one may not have: present rows of other segments."""

    version: Version
    number: _Integers
    """(K,): their numbers."""
    row: NDArray[np.void]
    """(K,) of ``ROW``."""

    def __getitem__(self, chosen: Any) -> _Side:
        return _Side(self.version, self.number[chosen], self.row[chosen])

    def names(self) -> RowNames:
        """Return number, seed and index of each row."""
        return np.stack([self.number, self.row["seed"], self.row["index"]], axis=1)


def compare(a: Version, b: Version, *, arrays: bool = False) -> Difference:
    """Return what two versions do not have in common.

    An episode is known by seed and index of its recipe; its number may differ.

    Args:
        a: one version.
        b: the other, the newer one.
        arrays: also count by array in how many changed rows it differs.

    Raises:
        StoreError: if one of them is damaged.
    """
    same = _same_segments(a.contents, b.contents)
    left, right = _side(a, same), _side(b, same)
    of_left, of_right = _common(left, right)
    both_left, both_right = left[of_left], right[of_right]
    differs = _differ(both_left.row, both_right.row)
    changed = both_left[differs], both_right[differs]
    removed = np.delete(left.names(), of_left, axis=0)
    present = a.contents.committed + a.contents.quarantined
    return Difference(
        a=a.name,
        b=b.name,
        added=np.delete(right.names(), of_right, axis=0),
        removed=removed,
        changed=changed[1].names(),
        unchanged=present - len(removed) - int(differs.sum()),
        arrays=_arrays(*changed) if arrays else None,
        settings=tuple(_settings(a.contents.attributes, b.contents.attributes)),
        labels=_labels(a.contents, b.contents),
        annotations=_annotations(a.contents, b.contents),
    )


def _same_segments(a: StoreContents, b: StoreContents) -> list[int]:
    pairs = zip(a.segments, b.segments, strict=False)
    return [k for k, (mine, other) in enumerate(pairs) if mine == other]


def _side(version: Version, without: Sequence[int]) -> _Side:
    left_out = set(without)
    kept = [k for k in range(len(version.contents.segments)) if k not in left_out]
    parts = [version.rows(k) for k in kept]
    numbers = [
        k * segments.ROWS + np.arange(len(part)) for k, part in zip(kept, parts, strict=True)
    ]
    row = np.concatenate(parts) if parts else np.empty(0, ROW)
    number = np.concatenate(numbers) if numbers else np.empty(0, np.int64)
    there = row["status"] != 0
    side = _Side(version, number, row)
    return side if there.all() else side[there]


def _common(a: _Side, b: _Side) -> tuple[_Integers, _Integers]:
    """Return the places, in each side, of the episodes that both have; in the same order."""
    keys = _keys(a.row, b.row)
    first = min(map(len, keys))
    is_ascending = [bool((np.diff(own) > 0).all()) for own in keys]
    for side, own, ascending in zip((a, b), keys, is_ascending, strict=True):
        if not ascending and len(np.unique(own)) < len(own):
            raise StoreError(f"{side.version.name} is damaged: two rows have the same recipe")
    if all(is_ascending) and np.array_equal(keys[0][:first], keys[1][:first]):
        return np.arange(first), np.arange(first)
    _, of_a, of_b = np.intersect1d(*keys, assume_unique=True, return_indices=True)
    order = np.argsort(of_b)
    return of_a[order], of_b[order]


def _keys(a: NDArray[np.void], b: NDArray[np.void]) -> tuple[_Integers, _Integers]:
    """Return a number for each row of both; equal numbers are equal seeds and indices."""
    seed, index = (np.concatenate([a[key], b[key]]) for key in ("seed", "index"))
    if (seed != seed[:1]).any():
        code = np.unique(seed, return_inverse=True)[1]
        values, index = np.unique(index, return_inverse=True)
        index = code * len(values) + index
    return index[: len(a)], index[len(a) :]


def _differ(a: NDArray[np.void], b: NDArray[np.void]) -> NDArray[np.bool_]:
    """Return for each pair of rows whether content or status differs, (K,)."""
    contents = [rows["checksum"].copy().view("<u8") for rows in (a, b)]
    return np.asarray((contents[0] != contents[1]).any(axis=1) | (a["status"] != b["status"]))


def _arrays(a: _Side, b: _Side) -> Mapping[str, int]:
    """Return for each array that both versions have in how many of these rows it differs."""
    both = (a.row["status"] == COMMITTED) & (b.row["status"] == COMMITTED)
    sides = (a[both], b[both])
    paths = [side.version.contents.arrays for side in sides]
    known = [path for path in paths[0] if path in set(paths[1])]
    counts = np.zeros(len(known), np.int64)
    values = [_digests(side, known) for side in sides]
    if len(sides[0].number):
        counts = (values[0] != values[1]).sum(axis=0)
    pairs = zip(known, counts.tolist(), strict=True)
    return dict(sorted(((p, n) for p, n in pairs if n), key=lambda pair: (-pair[1], pair[0])))


def _digests(side: _Side, paths: Sequence[str]) -> NDArray[np.uint32]:
    """Return the digests of some arrays of a side's rows, (K, len(paths))."""
    order = {path: i for i, path in enumerate(side.version.contents.arrays)}
    chosen = [order[path] for path in paths]
    out = np.empty((len(side.number), len(paths)), np.uint32)
    segment = side.number // segments.ROWS
    for k in np.unique(segment).tolist():
        mine = np.flatnonzero(segment == k)
        out[mine] = side.version.digests(k)[side.number[mine] - k * segments.ROWS][:, chosen]
    return out


def _settings(a: Mapping[str, Any], b: Mapping[str, Any]) -> Iterator[str]:
    """Yield the first differences of root attributes."""
    found = list(leaf_differences(a, b))
    yield from found[:_MOST_SETTINGS]
    if len(found) > _MOST_SETTINGS:
        yield f"and {len(found) - _MOST_SETTINGS} more"


def leaf_differences(a: Any, b: Any, where: str = "") -> Iterator[str]:
    """Yield ``key: a's value against b's`` for each difference of plain data."""
    if not (isinstance(a, Mapping) and isinstance(b, Mapping)):
        if a != b:
            yield f"{where}: {shown(a)} against {shown(b)}"
        return
    for key in [*a, *(key for key in b if key not in a)]:
        here = f"{where}.{key}" if where else str(key)
        if key in a and key in b:
            yield from leaf_differences(a[key], b[key], here)
        else:
            left, right = (shown(side.get(key, "absent")) for side in (a, b))
            yield f"{here}: {left} against {right}"


def _labels(a: StoreContents, b: StoreContents) -> dict[str, str]:
    words = {name: "removed" for name in a.labels if name not in b.labels}
    for name, label in b.labels.items():
        if name not in a.labels:
            words[name] = "added"
        elif a.labels[name] != label:
            words[name] = "changed"
    return dict(sorted(words.items()))


def _annotations(a: StoreContents, b: StoreContents) -> str:
    if a.annotations == b.annotations:
        return ""
    if a.annotations is None:
        return "added"
    return "changed" if b.annotations is not None else "removed"
