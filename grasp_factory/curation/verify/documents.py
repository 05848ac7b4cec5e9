"""Checks of a store's ``zarr.json`` files: existence, seals, and one number of rows."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from grasp_factory import __version__
from grasp_factory.core import schema
from grasp_factory.core.config.factory_config import FactoryConfig
from grasp_factory.core.json_text import parsed
from grasp_factory.core.limits import DOCUMENT
from grasp_factory.core.place import Place, place_of
from grasp_factory.curation.verify.length import document_rows
from grasp_factory.curation.verify.problems import Problem
from grasp_factory.errors import (
    ConfigError,
    IrregularFileError,
    LimitError,
    StoreError,
    StoreMismatchError,
)
from grasp_factory.writers.zarr import layout
from grasp_factory.writers.zarr.header import (
    fields_of,
    first_line,
    read_attributes,
    recorded_arrays,
)
from grasp_factory.writers.zarr.metadata_checksum import SEAL, is_intact

FILE = "zarr.json"
COPY_ROOT = (
    "make an empty store with the same generate command elsewhere (stop it at once) and copy its"
    " zarr.json here"
)


def read_document(file: Place) -> tuple[Any, str]:
    """Return a parsed ``zarr.json``, None if it cannot be parsed, and what is wrong with it."""
    try:
        document = parsed(file.read_bytes(DOCUMENT))
    except (FileNotFoundError, NotADirectoryError):
        return None, f"{FILE} is missing"
    except IrregularFileError:
        return None, f"{FILE} is no file, or in a folder that is a link"
    except LimitError as error:
        return None, str(error)
    except OSError as error:
        return None, f"{FILE} cannot be read: {error.strerror}"
    except ValueError as error:
        return None, f"{FILE} is no JSON: {first_line(error)}"
    return document, "" if is_intact(document) else f"{FILE} does not match its seal"


def root_problem(path: Path) -> Problem | None:
    """Return what is wrong with the root of the store at ``path``, if anything is.

    Raises:
        StoreMismatchError: if there is no store, or one of a newer or an older version.
    """
    if not path.is_dir():
        read_attributes(path)  # says what is there
    store = place_of(path)
    document, fault = read_document(store / FILE)
    first, _ = read_document(store / schema.STATUS.path / FILE)
    try:
        attributes = read_attributes(path)
        FactoryConfig.from_plain(attributes["config"])
    except StoreMismatchError:
        if not fault or first is None:
            raise
    except (StoreError, ConfigError) as error:
        fault = fault or first_line(error)
    if fault and first is not None and not (_has_seal(document) or _has_seal(first)):
        raise StoreMismatchError(
            f"{path} was made by a version that sealed no metadata: verify it with that version"
        )
    return Problem(episode=None, array="", what=fault, advice=COPY_ROOT) if fault else None


def has_config(path: Path) -> bool:
    """Return whether a damaged root still has exactly the config that it was made with."""
    document, _ = read_document(place_of(path) / FILE)
    try:
        attributes = read_attributes(path)
        FactoryConfig.from_plain(attributes["config"])
    except (StoreError, StoreMismatchError, ConfigError):
        return False
    text = json.dumps(document["attributes"]["config"], sort_keys=True, separators=(",", ":"))
    return bool(hashlib.sha256(text.encode()).hexdigest() == attributes["config_sha256"])


def array_documents(store: Place, config: FactoryConfig) -> Iterator[tuple[str, Any, str]]:
    """Yield path, document and fault of every array that a store of this config has."""
    attributes = read_attributes(store.path)
    fields = fields_of(store.path, config, attributes)
    recorded = schema.digested(fields.values())
    is_ours = attributes["versions"].get("grasp_factory") == __version__
    for name, field in fields.items():
        document, fault = read_document(store / name / FILE)
        if not fault and field == schema.DIGESTS and not recorded_arrays(document):
            fault = f"{FILE} does not list the array of each column"
        if not fault and is_ours and not _is_of(document, field, recorded):
            fault = f"{FILE} is that of another array"
        yield name, document, fault


def group_faults(store: Place, arrays: Iterable[str]) -> Iterator[tuple[str, str]]:
    """Yield path and fault of each damaged group among those of a store's arrays."""
    parents = {str(parent) for name in arrays for parent in Path(name).parents}
    for name in sorted(parents - {"."}):
        _, fault = read_document(store / name / FILE)
        if fault:
            yield name, fault


def length_problems(documents: Mapping[str, Any], rows: int) -> list[Problem]:
    """Return a problem for each array whose ``zarr.json`` has another number of rows."""
    found = ((name, document_rows(document)) for name, document in documents.items())
    return [
        Problem(
            episode=None,
            array=name,
            what=f"{'no number of' if got is None else got} rows, the store has {rows}",
        )
        for name, got in found
        if got != rows
    ]


def is_empty_group(document: Any) -> bool:
    """Return whether this is the ``zarr.json`` of a group without attributes, as Zarr writes it."""
    empty = {"attributes": {}, "zarr_format": 3, "node_type": "group"}
    return bool(document == empty)


def _is_of(document: Any, row: schema.Field, recorded: Sequence[str]) -> bool:
    """Return whether a sealed ``zarr.json`` has the attributes of a field's array."""
    attributes = {key: value for key, value in document["attributes"].items() if key != SEAL}
    return bool(
        attributes == layout.attributes(row, recorded)
        and document["dimension_names"] == layout.dimension_names(row)
    )


def _has_seal(document: Any) -> bool:
    attributes = document.get("attributes") if isinstance(document, dict) else None
    return isinstance(attributes, dict) and SEAL in attributes
