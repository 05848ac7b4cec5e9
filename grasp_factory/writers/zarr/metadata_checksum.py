"""Seals: each ``zarr.json`` holds a checksum of itself, so that changes are detected.

The checksum leaves out the number of rows, which grows; it is the same for all arrays of a store.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from grasp_factory.core.json_text import parsed
from grasp_factory.core.limits import DOCUMENT
from grasp_factory.core.place import Place

SEAL = "metadata_sha256"
"""The attribute that holds the checksum."""
VALUES_SEAL = "values_sha256"
"""The attribute of an array that is written once: the SHA-256 of its bytes."""

Document = Mapping[str, Any]


def seal(file: Place) -> None:
    """Add the seal to a ``zarr.json``."""
    write_sealed(file, parsed(file.read_bytes(DOCUMENT)))


def write_sealed(file: Place, document: Document) -> None:
    """Write a ``zarr.json`` with its seal."""
    attributes = document.get("attributes", {}) | {SEAL: _digest(document)}
    _write(file, {**document, "attributes": attributes})


def set_rows(file: Place, rows: int) -> None:
    """Change the number of rows in the ``zarr.json`` of an array, durably; its seal stays valid."""
    document = parsed(file.read_bytes(DOCUMENT))
    document["shape"][0] = rows
    _write(file, document, durable=True)


def is_intact(document: Any) -> bool:
    """Return whether a ``zarr.json``, parsed, matches its seal."""
    attributes = document.get("attributes") if isinstance(document, dict) else None
    return isinstance(attributes, dict) and attributes.get(SEAL) == _digest(document)


def is_sealed(file: Place) -> bool:
    """Return whether there is a ``zarr.json`` that matches its seal."""
    try:
        return is_intact(parsed(file.read_bytes(DOCUMENT)))
    except (OSError, ValueError):
        return False


def values_digest(values: NDArray[Any]) -> str:
    """Return the value of ``VALUES_SEAL`` for an array's values."""
    return hashlib.sha256(np.ascontiguousarray(values).data).hexdigest()


def _write(file: Place, document: Document, *, durable: bool = False) -> None:
    file.write(json.dumps(document, indent=2).encode(), durable=durable)


def _digest(document: Document) -> str:
    attributes = {k: v for k, v in document["attributes"].items() if k != SEAL}
    sealed = {**document, "attributes": attributes}
    if isinstance(document.get("shape"), list):
        sealed["shape"] = document["shape"][1:]
    text = json.dumps(sealed, sort_keys=True, separators=(",", ":"))
    return hashlib.sha256(text.encode()).hexdigest()
