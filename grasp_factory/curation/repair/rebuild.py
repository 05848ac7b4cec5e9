"""Rebuilding blocks: intact rows are kept, the others are simulated from their recipes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property, partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from grasp_factory.core import schema
from grasp_factory.core.content_checksum import checksum
from grasp_factory.core.episode import Episode
from grasp_factory.core.executors import SendMessage
from grasp_factory.core.place import Place
from grasp_factory.core.platforms import Fingerprint, difference, fingerprint_of, parsed
from grasp_factory.curation.repair.recovery import Recipe, recipe, recovered
from grasp_factory.curation.verify.contents import fingerprint_problems, read_block
from grasp_factory.curation.verify.partial_store import PartialStore, open_pieces
from grasp_factory.dataset.row_codec import Row
from grasp_factory.errors import StoreError
from grasp_factory.factory.block_job import Begun, BlockJob, summary_of
from grasp_factory.factory.plugins import activate
from grasp_factory.writers.base import Quarantined
from grasp_factory.writers.zarr.layout import block_files
from grasp_factory.writers.zarr.writer import COMMITTED, ZarrWriter

if TYPE_CHECKING:
    from grasp_factory.factory.block_maker import BlockMaker


@dataclass(frozen=True, slots=True, kw_only=True)
class RebuiltEpisode:
    """An episode that was simulated again."""

    episode: int
    before: str
    """The stored checksum; empty if it could not be read."""
    after: str

    @property
    def is_same(self) -> bool | None:
        """Whether it equals the episode that was stored; None if that is unknown."""
        return self.before == self.after if self.before else None


@dataclass(frozen=True, slots=True, kw_only=True)
class Mended:
    """The result of rebuilding one block."""

    block: int
    remade: tuple[RebuiltEpisode, ...] = ()
    lost: tuple[int, ...] = ()
    """Rows whose recipes cannot be recovered; nothing in the block was changed."""
    is_to_isolate: bool = False
    """Nothing in the block was changed, because simulating a recipe may end the process."""
    simulations: int = 0
    """Rows that must be simulated."""
    crashed: str = ""
    """How the simulation of a committed row has ended its process. Nothing was changed."""
    unknown_platform: tuple[int, ...] = ()
    """Rows that are intact except for the fingerprint, and that differ when they are simulated on
    this platform. Nothing in the block was changed."""
    recorded: tuple[int, ...] = ()
    """Rows of real episodes, which need their session. Nothing in the block was changed."""
    foreign: tuple[int, ...] = ()
    """Rows of another platform that must be simulated; that is done only if it is accepted."""
    difference: str = ""
    """How the platform of one of the foreign rows differs from this one."""


class BlockRebuilder:
    """Rebuilds blocks of a store in its template; ``RepairSession`` moves them into the store.

    Reports ``Begun`` and ``Made`` with the number of each row that is simulated, then ``Mended``.
    Only its arguments are sent to a worker. Each process opens both stores, and a world, when it
    first needs them.
    """

    def __init__(self, store: Path, template: Path, *, isolated: bool, accept: bool) -> None:
        """Open nothing yet.

        Args:
            store: the store to read.
            template: the store to write.
            isolated: whether the process may end, as a recipe may make it do.
            accept: whether rows of another platform are simulated, too.
        """
        self._store, self._template, self._isolated = store, template, isolated
        self._accept = accept

    def __reduce__(self) -> tuple[Any, ...]:
        again = partial(BlockRebuilder, isolated=self._isolated, accept=self._accept)
        return again, (self._store, self._template)

    def __call__(self, job: BlockJob, report: SendMessage) -> None:
        """Rebuild a block: keep intact rows, and simulate the others from their recipes."""
        pieces = self._pieces
        activate(pieces.config)
        found = dict(zip(pieces.rows_of(job.block), read_block(pieces, job.block)[0], strict=True))
        rows = {i: recovered(row, pieces, i) for i, row in found.items()}
        recipes = {i: recipe(found[i], pieces, i) for i, row in rows.items() if row is None}
        texts = {i: self._text(found[i], i) for i in rows if i not in recipes}
        unknown = {i: recipe(found[i], pieces, i) for i, text in texts.items() if text is None}
        came = self._foreseen(job.block, found, recipes, unknown)
        if came.lost or came.recorded or came.is_to_isolate or (came.foreign and not self._accept):
            report(came)
            return
        crashed = [i for i in job.lost if _is_committed(found[i])]
        if crashed:
            what = f"row {crashed[0]}: {job.lost[crashed[0]]}"
            report(replace(came, crashed=what))
            return
        remade = []
        simulated = {**recipes, **unknown}
        for i, how in simulated.items():
            row = self._simulated(i, how, job, report)
            after = checksum(row.contents())
            whole = rows[i]
            if whole and after != checksum(whole.contents()):
                report(replace(came, unknown_platform=tuple(unknown)))
                return
            rows[i] = row
            remade.append(RebuiltEpisode(episode=i, before=_recorded(found[i]), after=after))
        of_rows = [self._maker.fingerprint if i in simulated else texts[i] or "" for i in rows]
        self._writer.write_block(job.block, [row for row in rows.values() if row], of_rows)
        report(replace(came, remade=tuple(remade)))

    def _simulated(
        self, i: int, how: Recipe | None, job: BlockJob, report: SendMessage
    ) -> Episode | Quarantined:
        assert how
        if i not in job.lost:
            report(Begun(index=i))
        row = self._maker.make_row(how.spec(), job.lost.get(i, ""))
        report(summary_of(row, i))
        return row

    def _foreseen(
        self,
        block: int,
        found: Mapping[int, Row],
        recipes: Mapping[int, Recipe | None],
        unknown: Mapping[int, Recipe | None],
    ) -> Mended:
        """Return what is known of a block before any of its rows is simulated.

        Args:
            block: its number.
            found: its rows as they were read.
            recipes: recipes of the rows that must be simulated.
            unknown: recipes of intact rows whose platform is unknown. They are simulated, too: if
                the bytes are the same, this platform's fingerprint is right for them.
        """
        simulated = {**recipes, **unknown}
        differences = {i: self._difference(found[i]) for i in recipes}
        foreign = tuple(i for i in recipes if differences[i])
        is_to_isolate = bool(simulated) and not self._isolated
        return Mended(
            block=block,
            lost=tuple(i for i, how in simulated.items() if how is None),
            recorded=tuple(i for i, how in simulated.items() if how and how.is_real),
            is_to_isolate=is_to_isolate and (self._accept or not foreign),
            simulations=len(simulated),
            foreign=foreign,
            difference=next(filter(None, differences.values()), ""),
        )

    def _text(self, row: Row, i: int) -> str | None:
        """Return the fingerprint of a row that is kept; None if it is lost."""
        if schema.FINGERPRINT.path not in self._pieces.fields:
            return ""
        if schema.FINGERPRINT.path not in row or fingerprint_problems(row, self._pieces, i):
            return None
        return str(row[schema.FINGERPRINT.path])

    def _difference(self, row: Row) -> str:
        """Return how the platform that made a row differs from this one; empty if it does not."""
        known = parsed(str(row.get(schema.FINGERPRINT.path, "")))
        if known is None and not self._pieces.is_collected:
            known = fingerprint_of(self._pieces.attributes)
        return difference(known, Fingerprint.parse(self._maker.fingerprint))

    @cached_property
    def _pieces(self) -> PartialStore:
        return open_pieces(self._store)[0]

    @cached_property
    def _maker(self) -> BlockMaker:
        from grasp_factory.factory.block_maker import BlockMaker  # noqa: PLC0415 - and the simulator

        return BlockMaker(self._pieces.config, self._template)

    @cached_property
    def _writer(self) -> ZarrWriter:
        return ZarrWriter(self._template)


def _is_committed(row: Row) -> bool:
    return int(row.get(schema.STATUS.path, 0)) == COMMITTED


def _recorded(row: Row) -> str:
    """Return a committed row's stored checksum, or ``""``: a quarantined row's may be damaged."""
    return str(row.get(schema.CHECKSUM.path, "")) if _is_committed(row) else ""


def files_of(folder: Place, pieces: PartialStore, block: int) -> list[Place]:
    """Return all files of a block below ``folder``, the file of its commit marker last."""
    rows = pieces.rows_of(block)
    fields = sorted(pieces.fields.values(), key=lambda field: field == schema.STATUS)
    return [file for field in fields for file in block_files(folder, field, block, rows)]


def checksums(pieces: PartialStore, block: int) -> dict[int, str]:
    """Return the stored checksum of each row of a block; empty if it cannot be read."""
    rows = pieces.rows_of(block)
    try:
        found = pieces.arrays[schema.CHECKSUM.path].read(rows.start, rows.stop).tolist()
    except StoreError:
        found = [""] * len(rows)
    return dict(zip(rows, found, strict=True))
