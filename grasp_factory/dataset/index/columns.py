"""The columns of the index: their kinds, their units and their descriptions."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from grasp_factory.core.enums import Outcome, names
from grasp_factory.core.schema import FIELDS, NOT_IN_AN_EPISODE, Field
from grasp_factory.core.splits import SPLITS

STATUSES = ("committed", "quarantined")
"""Values of ``status``; missing rows are not in an index."""
OUTCOMES = tuple(names(Outcome))


@dataclass(frozen=True, slots=True, kw_only=True)
class IndexColumn:
    """A column of the index."""

    name: str
    kind: str
    """word (few different texts), text, number, whole, bool, json, time (ISO 8601, UTC) or tags."""
    units: str = ""
    description: str
    words: tuple[str, ...] = ()
    """The only values that a word column can have; empty if any value is possible."""


_TEXTS = ("object_id", "object_set", "object_family", "split", "policy", "grasp_proposer")
"""Text columns of a store whose values repeat."""
_WORDS = {"outcome": OUTCOMES, "split": SPLITS}


_RECORDED = {
    name: f"recorded_{name}" for name in ("operator", "duration", "scenario", "sensor_setup")
}
"""Columns of real episodes whose names the index uses for all episodes."""


def _kind(row: Field) -> str:
    if row.names or row.path.removeprefix("episodes/") in _TEXTS:
        return "word"
    if row.dtype == "string":
        return "text"
    return {"b": "bool", "f": "number"}.get(row.dtype[0], "whole")


def _stored() -> dict[str, Field]:
    """Return the columns of a store that the index copies, by name: one value per row each."""
    found = {row.path.removeprefix("episodes/"): row for row in FIELDS if not row.dims}
    beside = {path.removeprefix("episodes/") for path in NOT_IN_AN_EPISODE}
    return {
        _RECORDED.get(name, name): row
        for name, row in found.items()
        if "/" not in name and name not in beside and name != "spec"
    }


STORED: Mapping[str, Field] = _stored()
"""Columns that are copied from the store, with their fields of the schema."""


def stored_name(row: Field) -> str:
    """Return the name of a field's column in the store."""
    return row.path.removeprefix("episodes/")


def _columns() -> tuple[IndexColumn, ...]:
    own = {
        name: IndexColumn(
            name=name,
            kind=_kind(row),
            units=row.units,
            description=row.description,
            words=_WORDS.get(name, ()),
        )
        for name, row in STORED.items()
    }

    def c(name: str, kind: str, description: str, **more: str | tuple[str, ...]) -> IndexColumn:
        return IndexColumn(name=name, kind=kind, description=description, **more)  # type: ignore[arg-type]

    first = (
        c("store", "whole", "number of the store in the index"),
        c("row", "whole", "row in the store"),
        c("status", "word", "whether the row holds an episode", words=STATUSES),
        own.pop("success"),
        own.pop("outcome"),
        c("corrected_outcome", "word", "the outcome that a person set", words=OUTCOMES),
        c("tags", "tags", "tags that people set"),
        c("note", "text", "a person's note"),
        c("marks", "whole", "boxes and key points that people drew"),
        c("data_quality", "whole", "1 to 5, the best: a person's, else the store's quality"),
        c("scenario", "word", "where and among how many objects"),
        c("task_type", "word", "what is attempted"),
        c("lighting", "word", "how bright the light is, and from where it comes"),
        c("operator", "word", "who ran the arm: the policy, or the person of a real episode"),
        c("duration", "number", "of the attempt: its records over their rate", units="s"),
        c("file_size_mb", "number", "share of its block's files", units="MB"),
        c("created_at", "time", "when the row's block was committed on this disk"),
    )
    last = (
        c("checksum", "text", "SHA-256 over the episode's contents"),
        c("error", "text", "why the row is quarantined, or cannot be read"),
        c("extracted_path", "text", "where the store is"),
        c("sensor_setup", "json", "cameras, rates and touch that the store records"),
    )
    return (*first, *own.values(), *last)


COLUMNS: tuple[IndexColumn, ...] = _columns()
BY_NAME: Mapping[str, IndexColumn] = {column.name: column for column in COLUMNS}
OF_STORES = ("scenario", "task_type", "extracted_path", "sensor_setup")
"""Columns that have one value for all rows of a store; the database stores it once."""
OF_ROWS = tuple(column.name for column in COLUMNS if column.name not in OF_STORES)
OF_PEOPLE = ("corrected_outcome", "tags", "note", "marks", "data_quality")
"""Columns that depend on the annotations."""
