"""The card as JSON-LD for machines: Croissant 1.0."""

from __future__ import annotations

import glob
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from grasp_factory.apps.card.licences import licence_url
from grasp_factory.apps.card.table import TableColumn

CONFORMS_TO = "http://mlcommons.org/croissant/1.0"
RECORDS = "episodes"
"""The name of the record set."""

_CONTEXT: Mapping[str, Any] = {
    "@language": "en",
    "@vocab": "https://schema.org/",
    **{
        term: f"cr:{term}"
        for term in (
            *("citeAs", "column", "equivalentProperty", "extract", "field", "fileObject"),
            *("fileProperty", "fileSet", "format", "includes", "isLiveDataset", "jsonPath", "key"),
            *("md5", "parentField", "path", "recordSet", "references", "regex", "repeated"),
            *("replace", "samplingRate", "separator", "source", "subField", "transform"),
        )
    },
    "conformsTo": "dct:conformsTo",
    "cr": "http://mlcommons.org/croissant/",
    "data": {"@id": "cr:data", "@type": "@json"},
    "dataType": {"@id": "cr:dataType", "@type": "@vocab"},
    "dct": "http://purl.org/dc/terms/",
    "examples": {"@id": "cr:examples", "@type": "@json"},
    "rai": "http://mlcommons.org/croissant/RAI/",
    "sc": "https://schema.org/",
}


@dataclass(frozen=True, slots=True, kw_only=True)
class Described:
    """The description of a dataset as a whole."""

    name: str
    description: str
    licence: str
    url: str | None
    date_published: str | None
    version: str
    keywords: tuple[str, ...]
    limits: tuple[str, ...]
    """In Markdown, as ``description``."""
    made_with: str
    """The generator and its version."""


@dataclass(frozen=True, slots=True, kw_only=True)
class TableFile:
    """The file with the episodes."""

    name: str
    size: int
    """Bytes."""
    sha256: str
    columns: Sequence[TableColumn]


def croissant(described: Described, table: TableFile, store: str) -> str:
    """Return the JSON-LD text.

    Args:
        described: The dataset.
        table: The file with its episodes, in the same folder.
        store: Path of the store, relative to that folder.
    """
    facts = {
        "@context": _CONTEXT,
        "@type": "sc:Dataset",
        "conformsTo": CONFORMS_TO,
        "name": described.name,
        "description": described.description,
        "license": licence_url(described.licence),
        "url": described.url,
        "datePublished": described.date_published,
        "version": described.version,
        "citeAs": _citation(described),
        "keywords": list(described.keywords),
        "rai:dataLimitations": list(described.limits),
        "distribution": [_table_file(table), _store_files(store)],
        "recordSet": [_record_set(table)],
    }
    given = {key: value for key, value in facts.items() if value is not None}
    return json.dumps(given, indent=2) + "\n"


def _table_file(table: TableFile) -> dict[str, Any]:
    return {
        "@type": "cr:FileObject",
        "@id": table.name,
        "name": table.name,
        "description": "The columns with one value an episode, a line for each.",
        "contentUrl": table.name,
        "contentSize": f"{table.size} B",
        "encodingFormat": "text/csv",
        "sha256": table.sha256,
    }


def _store_files(store: str) -> dict[str, Any]:
    return {
        "@type": "cr:FileSet",
        "@id": "store",
        "name": "store",
        "description": (
            "The Zarr 3 store with everything: images, series and all columns. Its row is the"
            " record's `row`."
        ),
        "encodingFormat": "application/vnd+zarr",
        "includes": f"{glob.escape(store)}/**",
    }


def _record_set(table: TableFile) -> dict[str, Any]:
    return {
        "@type": "cr:RecordSet",
        "@id": RECORDS,
        "name": RECORDS,
        "description": "One record for each episode that was made.",
        "key": {"@id": f"{RECORDS}/row"},
        "field": [_field(table, column) for column in table.columns],
    }


def _field(table: TableFile, column: TableColumn) -> dict[str, Any]:
    return {
        "@type": "cr:Field",
        "@id": f"{RECORDS}/{column.name}",
        "name": column.name,
        "description": column.description,
        "dataType": column.kind.value,
        "source": {"fileObject": {"@id": table.name}, "extract": {"column": column.name}},
    }


def _citation(described: Described) -> str:
    """Return a BibTeX entry; characters that would end a value early are removed."""
    values = {
        "title": described.name,
        "year": (described.date_published or "")[:4],
        "note": f"Version {described.version}, made with {described.made_with}",
        "url": described.url or "",
    }
    lines = [f"  {key} = {{{_without_braces(value)}}}" for key, value in values.items() if value]
    return "@misc{dataset,\n" + ",\n".join(lines) + "\n}"


def _without_braces(text: str) -> str:
    return "".join(c for c in text if c not in "{}\\")
