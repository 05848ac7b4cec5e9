"""Data in a store other than rows: embedded data, added labels, packed segments, foreign files."""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Iterator, Sequence, Set
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from grasp_factory.core import schema
from grasp_factory.core.atomic_file import PARTIAL
from grasp_factory.core.enums import Outcome
from grasp_factory.core.object_storage.put_once import PROBE
from grasp_factory.core.place import Place, place_of
from grasp_factory.core.place_tree import Entries, entries, files_below
from grasp_factory.curation.signing import FOLDER as SIGNATURE_FOLDER
from grasp_factory.curation.signing import SIGNATURE, SUMS
from grasp_factory.curation.verify.documents import FILE, is_empty_group, read_document
from grasp_factory.curation.verify.foreign_chunks import is_recoded
from grasp_factory.curation.verify.partial_store import PartialStore
from grasp_factory.curation.verify.problems import Problem
from grasp_factory.dataset.annotations.log_file import FOLDER as ANNOTATIONS
from grasp_factory.dataset.annotations.log_file import NAME as LOG
from grasp_factory.errors import RefusedFileError, StoreError, shown
from grasp_factory.writers.zarr.block_attempt import ATTEMPT_FILE
from grasp_factory.writers.zarr.column_segments import FOLDER, Segment, apart, segments
from grasp_factory.writers.zarr.columns import Columns
from grasp_factory.writers.zarr.embedded import DESCRIPTIONS, embedded_in, read_embedded
from grasp_factory.writers.zarr.header import open_store
from grasp_factory.writers.zarr.label_columns import (
    LABEL_COLUMNS,
    LABELS,
    added_labels,
    label_folders,
    read_label,
)
from grasp_factory.writers.zarr.metadata_checksum import VALUES_SEAL, values_digest
from grasp_factory.writers.zarr.segment_packing import NOT_PACKED
from grasp_factory.writers.zarr.sizes import bytes_of_blocks
from grasp_factory.writers.zarr.staging import CREATING

_OTHER_FOLDERS = (ANNOTATIONS, LABELS, FOLDER, SIGNATURE_FOLDER, *DESCRIPTIONS)
"""Folders that are checked separately."""
_OWN_PARTIAL = re.compile(
    rf"[0-9]+(\.0)*{ATTEMPT_FILE}"
    rf"|(zarr\.json|[0-9]+-[0-9]+\.npz|SHA256SUMS(\.sig)?){re.escape(PARTIAL)}"
)
_CHUNK = re.compile(r"[0-9]+(\.[0-9]+)*")
_SHARED = "has blocks of another segment, and is not read"
_NUMBER = re.compile(r"(0|[1-9][0-9]{0,9})((?:\.0)*)")


def embedded_problems(pieces: PartialStore) -> Iterator[Problem]:
    """Yield a problem for each embedded array that differs from the one that was written."""
    arrays = list(embedded_in(pieces.config))
    for group in dict.fromkeys(array.partition("/")[0] for array in arrays):
        if fault := read_document(pieces.place / group / FILE)[1]:
            yield _problem(group, fault)
    for array in arrays:
        document, fault = read_document(pieces.place / array / FILE)
        if not fault or is_recoded(document):
            fault = _embedded_fault(pieces.path, array, document)
        if fault:
            yield _problem(array, fault)


def label_problems(pieces: PartialStore) -> Iterator[Problem]:
    """Yield a problem for each added label that differs from the one that was written."""
    path, labels = pieces.path, pieces.place / LABELS
    if not labels.is_dir():
        return
    names = label_folders(pieces.place)
    document, fault = read_document(labels / FILE)
    if fault and names and not is_empty_group(document):
        yield _problem(LABELS, fault)
    read = partial(read_label, open_store(path, mode="r")[0], rows=pieces.rows)
    for name in names:
        yield from _label_faults(pieces.place, name, read)


def _label_faults(
    store: Place, name: str, read: Callable[[str], NDArray[np.uint8]]
) -> Iterator[Problem]:
    """Yield a problem for each part of an added label that differs from what was written."""
    values = {}
    for part in ("", *LABEL_COLUMNS):
        array = f"{LABELS}/{name}/{part}".rstrip("/")
        document, fault = read_document(store / array / FILE)
        if part and (not fault or is_recoded(document)):
            try:
                values[part] = read(array)
                fault = _values_fault(values[part], document)
            except StoreError as error:
                fault = str(error)
        if fault:
            yield _problem(array, fault)
    if len(values) == len(LABEL_COLUMNS):
        outcome, success = (values[column] for column in LABEL_COLUMNS)
        if not np.array_equal(outcome == Outcome.SUCCESS, success):
            yield _problem(f"{LABELS}/{name}", "success and outcome do not agree")


def rewritten_arrays(pieces: PartialStore) -> Iterator[str]:
    """Yield the path of each added label or embedded array that another program has rewritten."""
    labels = added_labels(pieces.path)
    arrays = [f"{LABELS}/{name}/{column}" for name in labels for column in LABEL_COLUMNS]
    for array in [*arrays, *embedded_in(pieces.config)]:
        document, fault = read_document(pieces.place / array / FILE)
        if fault and is_recoded(document):
            yield array


def placeholder_problems(store: Place, name: str) -> Iterator[Problem]:
    """Yield a problem if a folder's placeholder is not that of an array of length 0."""
    document, fault = read_document(store / name / FILE)
    if not fault and document["shape"] != [0]:  # the seal does not cover it
        fault = f"shape {shown(document['shape'])}, valid: [0]"
    if fault:
        yield _problem(name, fault)


def packed_problems(pieces: PartialStore, broken: Set[int]) -> Iterator[Problem]:
    """Yield a problem for each packed segment that differs from its blocks.

    Args:
        pieces: The store.
        broken: Blocks with a problem; a segment that has one of them is not compared.
    """
    path, store = pieces.path, pieces.place
    if not (store / FOLDER).is_dir():
        return
    yield from placeholder_problems(store, FOLDER)
    if schema.STATUS.path not in pieces.arrays:
        return
    columns = Columns(path, pieces.config, pieces.arrays)
    there = columns.blocks()
    found = segments(store)
    read = {segment.file.name for segment in apart(found)}
    for segment in found:
        if segment.is_in(there) and broken.isdisjoint(segment.blocks):
            is_read = segment.file.name in read
            fault = _segment_fault(segment, columns, pieces) if is_read else _SHARED
            if fault:
                yield _problem(f"{FOLDER}/{segment.file.name}", fault)


def unknown_file_notes(pieces: PartialStore) -> Iterator[str]:
    """Yield a note for each folder with files that are not the store's; nothing reads them."""
    own = {path: len(field.dims) for path, field in pieces.fields.items()}
    parents = {str(parent) for path in own for parent in Path(path).parents}
    for folder in [
        pieces.place,
        *(pieces.place / name for name in sorted({*own, *parents} - {"."})),
    ]:
        name = folder.inner or "."
        inside = entries(folder) if folder.is_dir() else Entries([], [], [])
        known = {*own, *parents, *(_OTHER_FOLDERS if name == "." else ())}
        strange = [d for d in inside.folders if (folder / d).inner not in known]
        strange += [f for f in inside.files if not _is_own(f, name, pieces)] + inside.others
        if strange:
            yield _note(name, strange)
    yield from _leftovers(pieces)


def leftovers(store: Place) -> list[Place]:
    """Return what killed runs have left in a store, which is safe to remove.

    These are partial files, and the folders of labels that were being written.
    """
    own = [file for file in files_below(store) if _OWN_PARTIAL.fullmatch(file.name)]
    return own + (store / LABELS).glob(f".*{CREATING}")


def _leftovers(pieces: PartialStore) -> Iterator[str]:
    """Yield a note for leftovers of killed runs, and users' files, in folders without rows."""
    there = entries(pieces.place).folders
    for folder in _OTHER_FOLDERS:
        names = (pieces.place / folder).names() if folder in there else []
        left = [name for name in names if _is_left(name)]
        own = {FILE, *left, *_own_names(folder, names, pieces)}
        strange = [name for name in names if name not in own]
        yield from (_note(folder, found) for found in (left, strange) if found)


def _own_names(folder: str, names: Sequence[str], pieces: PartialStore) -> Sequence[str]:
    """Return the names that a store has in a folder without rows."""
    if folder == LABELS and names:
        return label_folders(pieces.place)
    return {ANNOTATIONS: [LOG], SIGNATURE_FOLDER: [SUMS, SIGNATURE]}.get(folder, names)


def _is_left(name: str) -> bool:
    return name.startswith(".") or name.endswith(PARTIAL)


def _is_own(file: str, folder: str, pieces: PartialStore) -> bool:
    if file == FILE or (folder == "." and file == PROBE):
        return True
    field, match = pieces.fields.get(folder), _NUMBER.fullmatch(file)
    if folder in pieces.rewritten:  # its chunks may have any shape
        return bool(_CHUNK.fullmatch(file))
    if field is None or match is None:
        return False
    most = pieces.rows if field.is_video else pieces.blocks
    return int(match[1]) < most and match[2] == ".0" * len(field.dims)


def _note(folder: str, names: list[str]) -> str:
    where = "" if folder == "." else f"{folder}: "
    left = [name for name in names if _is_left(name)]
    what = "left by a run that was killed" if len(left) == len(names) else "not the store's"
    more = f" and {len(names) - 3} more" if len(names) > 3 else ""
    return f"{where}{', '.join(map(shown, sorted(names)[:3]))}{more}: {what}; nothing reads it"


def _embedded_fault(path: Path, array: str, document: Any) -> str:
    try:
        content = read_embedded(path, array) or b""
    except StoreError as error:
        return str(error)
    return _values_fault(np.frombuffer(content, np.uint8), document)


def _values_fault(values: NDArray[Any], document: Any) -> str:
    is_same = values_digest(values) == document["attributes"].get(VALUES_SEAL)
    return "" if is_same else "does not match its checksum"


def _segment_fault(segment: Segment, columns: Columns, pieces: PartialStore) -> str:
    names = [name for name in columns.names if name not in NOT_PACKED]
    try:
        packed, size = columns.packed(segment, *names), segment.block_bytes()
    except RefusedFileError as error:
        return str(error)
    if packed is None or size is None:
        return "is damaged"
    rows = columns.rows(segment.blocks.start)[0], columns.rows(segment.blocks[-1])[1]
    for name, column in zip(names, packed, strict=True):
        try:
            values = columns.read_rows(name, *rows)
        except StoreError:
            continue  # the block has a problem for it
        if not _is_same(column, values):
            return f"its {name} is not that of the blocks"
    if not pieces.rewritten and size != bytes_of_blocks(columns, segment.blocks):
        return "counts other bytes than the blocks have"
    return ""


def _is_same(a: NDArray[Any], b: NDArray[Any]) -> bool:
    if (a.dtype, a.shape) != (b.dtype, b.shape):
        return False
    return a.tolist() == b.tolist() if a.dtype.kind == "T" else a.tobytes() == b.tobytes()


def _problem(array: str, what: str) -> Problem:
    return Problem(episode=None, array=array, what=what)


def thresholds_of(path: Path, name: str) -> Any:
    """Return the thresholds of an added label from its first intact part; None without any."""
    for part in ("", *LABEL_COLUMNS):
        place = place_of(path) / LABELS / name
        document, fault = read_document(place / part / FILE)
        if not fault and "thresholds" in document["attributes"]:
            return json.loads(json.dumps(document["attributes"]["thresholds"]))
    return None
