"""Making blocks again: rows that are whole are kept, the others simulated from their recipes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

from grasp_factory import schema
from grasp_factory.episode import Episode, checksum
from grasp_factory.errors import RecipeError, StoreError
from grasp_factory.executors import Report
from grasp_factory.rollout import run_episode
from grasp_factory.rows import Row
from grasp_factory.verifying.blocks import COMMITTED
from grasp_factory.verifying.contents import read_block
from grasp_factory.verifying.pieces import Pieces, open_pieces
from grasp_factory.verifying.recovery import kept, recipe
from grasp_factory.world import World
from grasp_factory.writers.base import Quarantined
from grasp_factory.writers.files import fsync
from grasp_factory.writers.layout import block_files
from grasp_factory.writers.zarr import ZarrWriter


@dataclass(frozen=True, slots=True, kw_only=True)
class Remade:
    """An episode that was simulated again."""

    episode: int
    before: str
    """Its checksum as it was stored; empty where none could be read."""
    after: str

    @property
    def is_same(self) -> bool | None:
        """Whether it is the episode that was there; None if nothing tells."""
        return self.before == self.after if self.before else None


@dataclass(frozen=True, slots=True, kw_only=True)
class Mended:
    """What came of one block."""

    block: int
    remade: tuple[Remade, ...] = ()
    lost: tuple[int, ...] = ()
    """Rows that are not made here; nothing of the block was changed."""
    known: Mapping[int, str] = field(default_factory=dict)
    """Checksums that rows of the block had, as far as something tells."""


class BlockMender:
    """Makes the blocks of a store anew in a template of it; they are put in place elsewhere.

    It travels to a worker as the paths. There, or here, it opens both, and a world, when it first
    needs them.
    """

    def __init__(self, store: Path, template: Path) -> None:
        self._store, self._template = store, template

    def __reduce__(self) -> tuple[Any, ...]:
        return BlockMender, (self._store, self._template)

    def __call__(self, block: int, report: Report) -> None:
        """Make a block; report the number of each row that is simulated, then ``Mended``."""
        pieces = self._pieces
        numbers = pieces.rows_of(block)
        rows: list[Episode | Quarantined] = []
        remade, lost, known = [], [], dict[int, str]()
        for i, row in zip(numbers, read_block(pieces, block)[0], strict=True):
            whole = kept(row, pieces, i)
            known[i] = checksum(whole.contents()) if whole else _recorded(row)
            if whole is None:
                spec = recipe(row, pieces, i) if self._may_make(row) else None
                if spec is None:
                    lost.append(i)
                    continue
                try:
                    whole = run_episode(self._world, spec)
                except RecipeError as error:
                    whole = Quarantined(spec, str(error))
                report(i)
                after = checksum(whole.contents())
                remade.append(Remade(episode=i, before=known[i], after=after))
            rows.append(whole)
        if lost:
            report(Mended(block=block, lost=tuple(lost), known=known))
            return
        self._writer.write_block(block, rows)
        report(Mended(block=block, remade=tuple(remade)))

    def _may_make(self, row: Row) -> bool:
        """Say whether to simulate a row here: one that is quarantined may end the process.

        The factory knows how to make those, but not in a store that was put together.
        """
        return self._pieces.is_collected or int(row.get(schema.STATUS.path, 0)) == COMMITTED

    def close(self) -> None:
        """Close the world, if one was opened in this process."""
        if "_world" in self.__dict__:
            self.__dict__.pop("_world").close()

    @cached_property
    def _pieces(self) -> Pieces:
        return open_pieces(self._store)[0]

    @cached_property
    def _world(self) -> World:
        return World(self._pieces.config.renderer)

    @cached_property
    def _writer(self) -> ZarrWriter:
        return ZarrWriter(self._template)


def _recorded(row: Row) -> str:
    """Return the checksum of an episode that is damaged; that of a quarantine may be damaged."""
    is_committed = int(row.get(schema.STATUS.path, 0)) == COMMITTED
    return str(row.get(schema.CHECKSUM.path, "")) if is_committed else ""


def files_of(folder: Path, pieces: Pieces, block: int) -> list[Path]:
    """Return all files of a block below ``folder``, that of its commit marker last."""
    rows = pieces.rows_of(block)
    fields = sorted(pieces.fields.values(), key=lambda field: field == schema.STATUS)
    return [file for field in fields for file in block_files(folder, field, block, rows)]


def remove_marker(pieces: Pieces, block: int) -> None:
    """Make a block one that is missing, for good."""
    file = block_files(pieces.path, schema.STATUS, block, pieces.rows_of(block))[0]
    file.unlink(missing_ok=True)
    fsync([file.parent])


def checksums(pieces: Pieces, block: int) -> dict[int, str]:
    """Return the stored checksum of each row of a block; empty for what has none to be read."""
    rows = pieces.rows_of(block)
    try:
        found = pieces.arrays[schema.CHECKSUM.path].read(rows.start, rows.stop).tolist()
    except StoreError:
        found = [""] * len(rows)
    return dict(zip(rows, found, strict=True))
