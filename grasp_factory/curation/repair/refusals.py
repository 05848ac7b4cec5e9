"""The reasons why rows are not simulated again: lines of the report, and limits."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from grasp_factory.core import schema
from grasp_factory.core.limits import LOST, MEMORY, SIMULATIONS
from grasp_factory.core.platforms import ACCEPT
from grasp_factory.curation.repair.template import Template
from grasp_factory.curation.verify.partial_store import PartialStore


def check_losses(path: Path, lost: int, rows: int) -> None:
    """Check that a store does not ask for far more simulations than it has whole rows.

    Args:
        path: the store.
        lost: rows of which it is known that they must be simulated.
        rows: all rows.

    Raises:
        LimitError: if it does.
    """
    SIMULATIONS.check(lost, path, so_far=True)
    LOST.check(lost - (rows - lost), path, so_far=True)


def all_rows_stay(pieces: PartialStore, template: Template) -> str:
    """Return why no block can be rebuilt in the layout of this version; empty if each can."""
    how = "take what is whole into a new store with grasp-factory split"
    if pieces.rewritten:
        what = f"another program has rewritten {min(pieces.rewritten)}"
        return f"rows stay as they are, for {what}: {how}"
    if why := _sensor_added_since(pieces):
        return why
    if other := template.differs_in_layout(pieces.arrays):
        what = f"{other} has other chunks or codecs than this version writes"
        return f"rows stay as they are, for {what}: {how}"
    return ""


def foreign_rows(rows: str, difference: str) -> str:
    """Return the line for rows of another platform, and how it differs from this one."""
    what = f"rows {rows} are of another platform and are not simulated here: {difference}"
    return f"{what}; repair where they were made, or add {ACCEPT}"


def rows_of_unknown_platform(rows: Iterable[int]) -> str:
    """Return the line for rows without a fingerprint that differ when they are simulated here."""
    numbers = ", ".join(map(str, rows))
    what = "are lost, and the rows have other bytes when they are simulated here"
    return f"fingerprints of rows {numbers} {what}: repair where they were made"


def rows_of_sessions(rows: Iterable[int]) -> str:
    """Return the line for rows of real episodes."""
    numbers = ", ".join(map(str, rows))
    what = f"rows {numbers} are real episodes and cannot be simulated"
    return f"{what}: import their session again with `grasp-factory capture import`"


def rows_without_recipe(rows: Iterable[int]) -> str:
    """Return the line for rows whose recipe is lost."""
    numbers = ", ".join(map(str, rows))
    return f"rows {numbers} cannot be made again: nothing is left that tells the recipe"


def _sensor_added_since(pieces: PartialStore) -> str:
    """Return the line for a store from before a sensor was added; empty for any other."""
    here = schema.digested(schema.expand(pieces.config))
    added = next((path for path in here if path not in pieces.fields), "")
    if not added:
        return ""
    what = f"this version also records {added}, which the store does not have"
    return f"rows stay as they are: {what}; repair with its own version"


def row_that_crashes(what: str) -> str:
    """Return the line for a row whose simulation ends its process."""
    return f"{what}, so its block stays as it is; if memory was short: {MEMORY.advice}"
