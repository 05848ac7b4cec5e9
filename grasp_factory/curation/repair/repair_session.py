"""Repairing a locked store: metadata first, then the blocks with a damaged row."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Collection, Iterable, Mapping
from functools import partial
from pathlib import Path
from typing import Any

from grasp_factory import __version__
from grasp_factory.core.config.factory_config import FactoryConfig
from grasp_factory.core.limits import SIMULATIONS
from grasp_factory.core.place import fsync_places, place_of
from grasp_factory.core.schema import Field
from grasp_factory.curation import isolation
from grasp_factory.curation.repair.rebuild import (
    BlockRebuilder,
    Mended,
    RebuiltEpisode,
    files_of,
)
from grasp_factory.curation.repair.refusals import (
    all_rows_stay,
    check_losses,
    foreign_rows,
    row_that_crashes,
    rows_of_sessions,
    rows_of_unknown_platform,
    rows_without_recipe,
)
from grasp_factory.curation.repair.template import Template
from grasp_factory.curation.verify.annotation_log import mend_annotations
from grasp_factory.curation.verify.auxiliary_data import leftovers
from grasp_factory.curation.verify.documents import COPY_ROOT, FILE, has_config, read_document
from grasp_factory.curation.verify.partial_store import PartialStore, open_pieces
from grasp_factory.curation.verify.problems import Problem, VerifyReport
from grasp_factory.curation.verify.verification import check_blocks, executor_for
from grasp_factory.dataset.annotations.log_file import FOLDER as ANNOTATIONS
from grasp_factory.errors import ConfigError, GraspFactoryError
from grasp_factory.factory import embedded_assets
from grasp_factory.factory.block_job import Begun, BlockJob, Made
from grasp_factory.factory.name_check import check_names
from grasp_factory.factory.plugins import activate
from grasp_factory.factory.retry_policy import Losses
from grasp_factory.factory.run_request import EPISODE_TIMEOUT_S
from grasp_factory.writers.zarr.column_segments import FOLDER, segments, unpack_block
from grasp_factory.writers.zarr.embedded import embedded_in
from grasp_factory.writers.zarr.header import SOURCES, root_attributes
from grasp_factory.writers.zarr.label_columns import LABELS
from grasp_factory.writers.zarr.metadata_checksum import SEAL
from grasp_factory.writers.zarr.store import create_store

FEW = 2
"""For up to this many blocks, no process is started."""


class RepairSession:
    """One repair's changes to a store whose lock is held.

    Attributes:
        mended: what was repaired or removed, one line each.
        failed: what could not be repaired, and why, one line each.
        remade: episodes that were simulated again.
    """

    def __init__(
        self, path: Path, workers: int, on_episode: Callable[[int], None], *, accept: bool
    ) -> None:
        """Change nothing yet.

        Args:
            path: the store.
            workers: processes.
            on_episode: called with the number of each row that is checked or simulated.
            accept: also simulate rows of another platform here.
        """
        self._path, self._workers, self._on_episode = path, workers, on_episode
        self._place = place_of(path)
        self._accept = accept
        self.mended: list[str] = []
        self.failed: list[str] = []
        self.remade: list[RebuiltEpisode] = []

    def run(self, found: VerifyReport) -> bool:
        """Repair what was found, except added labels.

        Returns:
            Whether the rest can be repaired: not if the root's metadata is lost.

        Raises:
            LimitError: if far more rows are lost than a damaged store lacks.
        """
        problems = found.problems
        SIMULATIONS.check(found.missing, self._path)
        if _is_of_root(problems) and not self._mend_root():
            return False
        pieces = open_pieces(self._path)[0]
        with contextlib.suppress(GraspFactoryError):  # a damaged copy is repaired from the cache
            embedded_assets.unpack(self._path, pieces.config)
        fields = pieces.fields.values()
        with self._template(pieces.config, pieces.attributes, pieces.rows, fields) as template:
            damaged = [p.array for p in problems if p.episode is None and p.array]
            has_changed = self._mend_documents(template, pieces, damaged)
            self._remove_packed(damaged)
            self._mend_annotations(problems)
            self._remove_leftovers()
            pieces, unreadable = open_pieces(self._path)
            if unreadable:
                self.failed.append("rows stay as they are, for whole arrays cannot be read")
                return True
            if has_changed:  # the values of these arrays were not checked yet
                blocks = range(pieces.blocks)
                checked = check_blocks(pieces, blocks, self._workers, self._on_episode)
                problems = tuple(checked.problems)
            size = pieces.config.block_size
            broken = {p.episode // size for p in problems if p.episode is not None}
            if broken and (why := all_rows_stay(pieces, template)):
                self.failed.append(why)
                return True
            self._mend_blocks(template, pieces, sorted(broken))
        return True

    def _mend_root(self) -> bool:
        """Rebuild the root's metadata; return whether that could be done.

        This is done only if the metadata that is left equals the metadata that is rebuilt here.
        """
        # This loads the simulator.
        from grasp_factory.factory.generate import origin_attributes  # noqa: PLC0415

        place = self._place / FILE
        if has_config(self._path):
            left = read_document(place)[0]["attributes"]
            config = FactoryConfig.from_plain(left["config"])
            activate(config)
            more = origin_attributes(config, check_names(config))
            more |= {key: left[key] for key in (SOURCES,) if key in left}
            with self._template(config, root_attributes(config, more), rows=0) as template:
                made = read_document(template.place / FILE)[0]["attributes"]
                if left.get(SEAL) == made[SEAL] or left == made | {SEAL: left.get(SEAL)}:
                    template.give_document("")
                    self.mended.append(f"{FILE} of the root is made again")
                    return True
        self.failed.append(f"{FILE} of the root cannot be made again: {COPY_ROOT}")
        return False

    def _template(
        self,
        config: FactoryConfig,
        attributes: Mapping[str, Any],
        rows: int,
        fields: Collection[Field] = (),
    ) -> Template:
        activate(config)
        robot = check_names(config)
        try:
            files = embedded_assets.packed(config)
        except ConfigError:  # this machine has lost some of it
            files = {}
        create = partial(
            create_store,
            config=config,
            attributes={key: value for key, value in attributes.items() if key != SEAL},
            joints=len(robot.arm_joints),
            n=rows,
            carried=files,
            fields=fields,
        )
        return Template(self._path, create)

    def _mend_documents(
        self, template: Template, pieces: PartialStore, damaged: Iterable[str]
    ) -> bool:
        """Rebuild metadata and embedded data; return whether the metadata of any array changed."""
        why = ""
        if other := template.differs(pieces.arrays):
            why = f"{FILE} of {other}, which is whole, is not as this version writes it"
        elif not pieces.arrays:
            self.mended.append(f"the store has {pieces.rows} rows, as far as its files tell")
            made_by = pieces.attributes["versions"].get("grasp_factory")
            if made_by != __version__:
                why = f"version {made_by} made the store, and no other array's is left to compare"
        has_changed = False
        for name in damaged:
            if name == LABELS:
                template.give_empty_group(name)
            elif name.split("/")[0] in (ANNOTATIONS, LABELS, FOLDER):
                continue
            elif why:
                self.failed.append(f"{name}/{FILE} cannot be made again here: {why}")
                continue
            elif not (template.place / name / FILE).exists():
                how = f"{embedded_assets.how_to_import(name)}, and repair again"
                self.failed.append(f"{name} cannot be made again: {how}")
                continue
            else:
                template.give_document(name)
                if name in embedded_in(pieces.config):
                    chunks = (template.place / name).glob("[0-9]*")
                    template.give_files(chunks)
                has_changed |= name in pieces.fields
            self.mended.append(f"{name}/{FILE} is made again")
        return has_changed

    def _remove_packed(self, damaged: Iterable[str]) -> None:
        """Remove packed segments that are damaged; all of them with the folder's metadata."""
        for segment in segments(self._place):
            if {FOLDER, f"{FOLDER}/{segment.file.name}"} & set(damaged):
                segment.file.unlink()
                self.mended.append(f"{FOLDER}/{segment.file.name} is removed; it is derived")
        if FOLDER in damaged:
            (self._place / FOLDER / FILE).unlink(missing_ok=True)
            fsync_places([self._place / FOLDER])

    def _mend_annotations(self, problems: Iterable[Problem]) -> None:
        mended, failed = mend_annotations(self._path, problems)
        self.mended += mended
        self.failed += failed

    def _remove_leftovers(self) -> None:
        for file in leftovers(self._place):
            file.rmtree() if file.is_dir() else file.unlink()
            self.mended.append(f"{file.inner} is removed: a run that was killed had left it")

    def _mend_blocks(self, template: Template, pieces: PartialStore, blocks: list[int]) -> None:
        """Keep the intact rows of these blocks, and simulate the others."""
        losses = Losses(pieces.config.block_size, EPISODE_TIMEOUT_S, self.mended.append)
        to_isolate: dict[int, int] = {}
        foreign: list[Mended] = []

        def hear(message: Begun | Made | Mended) -> None:
            if not isinstance(message, Mended):
                made = losses.news(message)
                if made:
                    self._on_episode(made.index)
            elif message.lost:
                self.failed.append(rows_without_recipe(message.lost))
            elif message.recorded:
                self.failed.append(rows_of_sessions(message.recorded))
            elif message.unknown_platform:
                self.failed.append(rows_of_unknown_platform(message.unknown_platform))
            elif message.crashed:
                self.failed.append(row_that_crashes(message.crashed))
            elif message.foreign and not message.is_to_isolate:
                foreign.append(message)
                if self._accept:
                    self._put_in_place(template, pieces, message)
            elif message.is_to_isolate:
                to_isolate[message.block] = message.simulations
                check_losses(self._path, sum(to_isolate.values()), pieces.rows)
            else:
                self._put_in_place(template, pieces, message)

        rebuilder = partial(BlockRebuilder, self._path, template.place.path, accept=self._accept)
        how = (hear, losses.recover, losses.silence)
        reading = executor_for(self._workers, len(blocks), few=FEW)
        jobs = [BlockJob(block=block) for block in blocks]
        reading.run(rebuilder(isolated=False), jobs, *how)
        if to_isolate:
            simulating = isolation.isolated(min(self._workers, len(to_isolate)))
            jobs = [BlockJob(block=block) for block in to_isolate]
            simulating.run(rebuilder(isolated=True), jobs, *how)
        self._report_foreign(foreign)

    def _put_in_place(self, template: Template, pieces: PartialStore, made: Mended) -> None:
        """Move a complete block into the store at once, so that the template does not grow."""
        unpack_block(self._place, made.block)
        files = files_of(template.place, pieces, made.block)
        # Arrays that another program has rewritten are in another layout.
        others = {(template.place / name).inner for name in pieces.rewritten}
        template.give_files(file for file in files if file.parent.inner not in others)
        self.remade += made.remade
        rows = pieces.rows_of(made.block)
        self.mended.append(f"rows {rows[0]} to {rows[-1]} are whole again")

    def _report_foreign(self, blocks: list[Mended]) -> None:
        """Report whether rows of another platform were simulated here."""
        if not blocks:
            return
        rows, why = ", ".join(str(r) for b in blocks for r in b.foreign), blocks[0].difference
        if self._accept:
            self.mended.append(f"rows {rows} are of this platform now: {why}")
        else:
            self.failed.append(foreign_rows(rows, why))


def _is_of_root(problems: Iterable[Problem]) -> bool:
    """Return whether one of these is a problem of the root's own metadata."""
    return any(problem.episode is None and not problem.array for problem in problems)
