"""Checks of a block's rows: whether they can be read and match their checksums."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from grasp_factory.core import schema
from grasp_factory.core.content_checksum import checksum
from grasp_factory.core.place import Place
from grasp_factory.core.schema import Field
from grasp_factory.curation.verify.partial_store import PartialStore
from grasp_factory.curation.verify.problems import Problem
from grasp_factory.dataset.row_codec import Row, fixed, is_fill, text_of
from grasp_factory.dataset.row_integrity import (
    QUARANTINE_PATHS,
    episode_contents,
    is_valid_fingerprint,
    mismatched,
    must_have_fingerprints,
    quarantine_checksum,
)
from grasp_factory.errors import IrregularFileError, StoreError
from grasp_factory.writers.zarr.array_reader import StoredArray
from grasp_factory.writers.zarr.layout import block_files

_NOT_CHECKED = (schema.STATUS.path, schema.CHECKSUM.path)


def read_block(pieces: PartialStore, block: int) -> tuple[list[Row], list[Problem]]:
    """Return the rows of a block with their padding, and a problem for each unreadable value.

    Unreadable values are left out of their rows.
    """
    rows = pieces.rows_of(block)
    out: list[Row] = [{} for _ in rows]
    problems = []
    for path, array in pieces.arrays.items():
        field = pieces.fields[path]
        file = block_files(pieces.place, field, block, rows)[0]
        has_own_files = not field.is_video and path not in pieces.rewritten
        if has_own_files and (fault := _fault_of(file)):
            what = f"file {file.name} {fault}, which has rows {rows[0]} to {rows[-1]}"
            problems.append(_problem(rows[0], path, what))
            continue
        for k, value in _values(array, rows, field):
            if isinstance(value, StoreError):
                problems.append(_problem(rows[k], path, _without_place(str(value))))
            else:
                out[k][path] = value
    return out, problems


def _fault_of(file: Place) -> str:
    """Return what is wrong with a file; files of fill values alone are written too."""
    try:
        return "" if file.exists() else "is missing"
    except IrregularFileError:
        return "is a link or no regular file"


def trimmed(row: Mapping[str, NDArray[Any]], fields: Mapping[str, Field]) -> Row:
    """Return the contents of a committed row: without padding, status, checksum and digests.

    A time series whose length is unknown or impossible is left out.
    """
    out = {}
    for path, value in episode_contents(row).items():
        length = fields[path].length_column
        if not length:
            out[path] = value
        elif length in row and 0 <= row[length] <= len(value):
            out[path] = value[: row[length]]
    return out


def committed_problems(row: Row, contents: Row, pieces: PartialStore, i: int) -> list[Problem]:
    """Return the problems of a committed row: values that do not match digest or checksum.

    Args:
        row: As it was read.
        contents: The result of ``trimmed``.
        pieces: The store.
        i: The row's number.
    """
    stored, wrong = row.get(schema.CHECKSUM.path), _wrong_digests(row, contents, pieces)
    if is_whole(row, contents, pieces):
        what = "does not match the values, which match the checksum of the episode"
        return [_problem(i, schema.DIGESTS.path, f"{what} ({path})") for path in wrong[:1]]
    wrong = [path for path in wrong if pieces.fields[path].length_column not in wrong]
    out = [_problem(i, path, "does not match its checksum") for path in wrong]
    lengths = {field.length_column for field in pieces.fields.values()} - {""}
    out += [
        _problem(i, path, f"{int(row[path])} is no length of a time series")
        for path in sorted(lengths & set(row))
        if not _is_length(path, int(row[path]), pieces)
    ]
    if is_complete(contents, pieces) and stored is not None and not out:
        is_certain = schema.DIGESTS.path in row
        what = (
            "does not match the values, which match their own" if is_certain else "does not match"
        )
        out.append(_problem(i, schema.CHECKSUM.path, what))
    return out


def quarantined_problems(row: Row, pieces: PartialStore, i: int) -> list[Problem]:
    """Return the problems of the recipe and the reason of a quarantined row."""
    stored = row.get(schema.CHECKSUM.path)
    if stored is None or not all(path in row for path in QUARANTINE_PATHS):
        return []  # it could not be read, which is a problem already
    if quarantine_checksum(row) != str(stored):
        what = "does not match recipe and reason of the quarantine"
        return [_problem(i, schema.CHECKSUM.path, what)]
    if not pieces.is_collected and int(row["episodes/index"]) != i:
        return [_problem(i, "episodes/index", f"{int(row['episodes/index'])}, another row's")]
    return []


def fingerprint_problems(row: Row, pieces: PartialStore, i: int) -> list[Problem]:
    """Return the problems of a row's fingerprint; see ``must_have_fingerprints``."""
    text = text_of(row, schema.FINGERPRINT.path)
    required = must_have_fingerprints(pieces.attributes)
    if schema.FINGERPRINT.path not in row or is_valid_fingerprint(text, required=required):
        return []
    what = "is no fingerprint, or is damaged" if text else "is lost"
    return [_problem(i, schema.FINGERPRINT.path, what)]


def is_complete(contents: Row, pieces: PartialStore) -> bool:
    """Return whether all values of an episode could be read."""
    return all(p in contents for p in pieces.fields if p not in schema.NOT_IN_AN_EPISODE)


def is_whole(row: Row, contents: Row, pieces: PartialStore) -> bool:
    """Return whether all values of an episode could be read and match the row's checksum."""
    stored = text_of(row, schema.CHECKSUM.path)
    return bool(stored) and is_complete(contents, pieces) and checksum(contents) == stored


def padding_problems(
    row: Mapping[str, NDArray[Any]], kept: Mapping[str, int], pieces: PartialStore, i: int
) -> list[Problem]:
    """Return a problem if a row has values where there should be only fill values.

    Args:
        row: As it was read.
        kept: By path, how many values come before the padding; a path that is left out has none.
        pieces: The store.
        i: The row's number.
    """
    filled = [
        path
        for path, value in row.items()
        if path in kept
        and not is_fill(np.atleast_1d(value)[kept[path] :], pieces.fields[path].fill)
    ]
    if not filled:
        return []
    others = f", and so do {len(filled) - 1} other arrays" if len(filled) > 1 else ""
    return [_problem(i, filled[0], f"holds something where nothing was recorded{others}")]


def behind_problems(pieces: PartialStore, block: int) -> list[Problem]:
    """Return a problem if the files of a short last block have values after its last row."""
    rows = pieces.rows_of(block)
    stop = rows.start + pieces.config.block_size
    for path, array in pieces.arrays.items():
        field = pieces.fields[path]
        if rows.stop == stop or field.is_video or path in pieces.rewritten:
            continue
        with contextlib.suppress(StoreError):  # a problem of the rows already
            values = np.array([fixed(value) for value in array.read(rows.stop, stop)])
            if len(values) and not is_fill(values, field.fill):
                return [_problem(rows[-1], path, "holds something behind the last row")]
    return []


def padded(row: Row, pieces: PartialStore) -> dict[str, int]:
    """Return how many values of a committed row come before padding; see ``padding_problems``."""
    out = {schema.ERROR.path: 0}
    for path in row:
        length = pieces.fields[path].length_column
        if length in row:
            out[path] = int(row[length])
    return out


def empty_lengths(paths: tuple[str, ...], pieces: PartialStore) -> dict[str, int]:
    """Return 0 for each path where a row must have no values; see ``padding_problems``."""
    return {path: 0 for path in pieces.fields if path not in (*paths, *_NOT_CHECKED)}


def _values(
    array: StoredArray, rows: range, field: Field
) -> Iterator[tuple[int, NDArray[Any] | StoreError]]:
    """Yield each row's position and value, or the error if it cannot be read."""
    if not field.is_video:  # a block of videos would be too large to hold
        try:
            for k, value in enumerate(array.read(rows.start, rows.stop)):
                yield k, fixed(value)
            return
        except StoreError:
            pass  # some may be readable by themselves
    for k, row in enumerate(rows):
        try:
            yield k, fixed(array.read(row, row + 1)[0])
        except StoreError as error:
            yield k, error


def _wrong_digests(row: Row, contents: Row, pieces: PartialStore) -> list[str]:
    """Return the paths whose values do not match their digests; empty without digests."""
    if schema.DIGESTS.path not in row:
        return []
    differs = mismatched(contents, pieces.digested, row[schema.DIGESTS.path])
    return [path for path in differs if differs[path]]


def _is_length(path: str, length: int, pieces: PartialStore) -> bool:
    rooms = [
        array.zarr.shape[1]
        for name, array in pieces.arrays.items()
        if pieces.fields[name].length_column == path
    ]
    return 0 <= length <= min(rooms, default=length)


def _without_place(text: str) -> str:
    """Return the end of an error's text, which begins with store, array and rows."""
    return "cannot be read: " + text.partition("cannot be read: ")[2]


def _problem(i: int, array: str, what: str) -> Problem:
    return Problem(episode=i, array=array, what=what)
