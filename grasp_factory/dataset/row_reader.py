"""Whole rows of a store, each compared with its checksum."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from grasp_factory.core import schema
from grasp_factory.core.config.factory_config import FactoryConfig
from grasp_factory.core.content_checksum import checksum
from grasp_factory.core.episode import Episode, EpisodeSpec
from grasp_factory.dataset.row_codec import Row, assemble, read_rows, text_of
from grasp_factory.dataset.row_integrity import is_valid_fingerprint, must_have_fingerprints
from grasp_factory.errors import StoreError
from grasp_factory.writers.base import Quarantined
from grasp_factory.writers.zarr.columns import check_lengths
from grasp_factory.writers.zarr.field_arrays import open_arrays
from grasp_factory.writers.zarr.header import fields_of, open_store
from grasp_factory.writers.zarr.writer import COMMITTED, QUARANTINED


@dataclass(frozen=True, slots=True, kw_only=True)
class StoredRow:
    """A row that matches its checksum."""

    content: Episode | Quarantined
    checksum: str
    fingerprint: str
    """Text that identifies the platform that made the row; empty if the store has none."""


class RowReader:
    """Reads whole rows of a store.

    Attributes:
        path: the path of the store.
        config: the configuration that it was made from.
        joints: the number of joints of its robot.
    """

    def __init__(self, path: Path) -> None:
        """Open the store at ``path``.

        Raises:
            StoreMismatchError: if there is no store.
            StoreError: if it is damaged, or lacks an array.
        """
        self.path = path
        root, self.config = open_store(path, mode="r")
        attributes = root.attrs.asdict()
        self.fields = fields_of(path, self.config, attributes)
        self._must_have_fingerprints = must_have_fingerprints(attributes)
        self._arrays = open_arrays(root, self.config, self.fields, set(self.fields))
        try:
            check_lengths(path, self._arrays)
        except StoreError as error:
            raise StoreError(f"{error}; {mending(path)}") from None
        self.joints: int = self._joints()

    def _joints(self) -> int:
        path = "streams/joint_positions"
        if path not in self._arrays:
            raise StoreError(f"{self.path} is damaged: {path} is missing; {mending(self.path)}")
        return int(self._arrays[path].zarr.shape[-1])

    def read(self, start: int, stop: int) -> Iterator[StoredRow]:
        """Yield rows ``start`` to ``stop`` - 1, which are all in one block.

        Raises:
            StoreError: naming the row, if one is missing or damaged.
        """
        try:
            rows = read_rows(
                lambda path, i, j: self._arrays[path].read(i, j), self.fields, start, stop
            )
        except StoreError as error:
            raise StoreError(f"{error}; {mending(self.path)}") from None
        for i, row in enumerate(rows, start):
            yield self._checked(i, row)

    def _checked(self, i: int, row: Row) -> StoredRow:
        try:
            content = _content(row, self.config)
        except (KeyError, TypeError, ValueError, RecursionError) as error:
            raise self._damaged(i, f"is damaged: {error}") from None
        found = checksum(content.contents())
        if found != text_of(row, schema.CHECKSUM.path):
            raise self._damaged(i, "does not match its checksum")
        text = text_of(row, schema.FINGERPRINT.path)
        if not is_valid_fingerprint(text, required=self._must_have_fingerprints):
            raise self._damaged(i, f"has a damaged {schema.FINGERPRINT.path}")
        return StoredRow(content=content, checksum=found, fingerprint=text)

    def _damaged(self, i: int, what: str) -> StoreError:
        return StoreError(f"{self.path}: episode {i} {what}; {mending(self.path)}")


def mending(path: Path) -> str:
    """Return the advice, for error messages, on how to repair a damaged store."""
    return f"run `grasp-factory verify {path}`, then `grasp-factory repair {path}`"


def _content(row: Row, config: FactoryConfig) -> Episode | Quarantined:
    match int(row[schema.STATUS.path]):
        case status if status == COMMITTED:
            return assemble(row, config.cameras)
        case status if status == QUARANTINED:
            spec = EpisodeSpec.from_json(str(row["episodes/spec"]))
            return Quarantined(spec, str(row[schema.ERROR.path]))
        case _:
            raise ValueError("it is missing")
