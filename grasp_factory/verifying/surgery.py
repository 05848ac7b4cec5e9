"""Changing a store that is locked: metadata first, then the blocks that hold a broken row."""

from __future__ import annotations

import contextlib
import shutil
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Any

from grasp_factory import carried, schema
from grasp_factory.config import FactoryConfig
from grasp_factory.errors import ConfigError, GraspFactoryError
from grasp_factory.factory import check_names
from grasp_factory.verifying.beside import LABELS, leftovers
from grasp_factory.verifying.documents import COPY_ROOT, FILE, has_config, read_document
from grasp_factory.verifying.mending import (
    BlockMender,
    Mended,
    Remade,
    files_of,
    remove_marker,
)
from grasp_factory.verifying.pieces import Pieces, open_pieces
from grasp_factory.verifying.problems import Problem, Report
from grasp_factory.verifying.template import Template
from grasp_factory.verifying.verification import check_blocks, executor_for
from grasp_factory.writers.files import fsync
from grasp_factory.writers.header import SOURCES, root_attributes
from grasp_factory.writers.layout import block_files
from grasp_factory.writers.objects import GROUP
from grasp_factory.writers.packed import FOLDER, segments, unpack_block
from grasp_factory.writers.seals import SEAL

FEW = 2
"""Blocks up to which no process is started."""


class Surgery:
    """One repair's changes to a store whose lock is held.

    Attributes:
        mended: what was made again or removed, one line each.
        failed: what could not be, and why.
        remade: episodes that were simulated again.
        to_generate: rows that the factory has to make, with the checksums that they had.
        blocks: those of these rows.
    """

    def __init__(self, path: Path, workers: int, on_episode: Callable[[int], None]) -> None:
        self._path, self._workers, self._on_episode = path, workers, on_episode
        self.mended: list[str] = []
        self.failed: list[str] = []
        self.remade: list[Remade] = []
        self.to_generate: dict[int, str] = {}
        self.blocks: list[int] = []

    def run(self, found: Report) -> bool:
        """Mend what was found, but for rows that the factory has to make, and added labels.

        Returns:
            Whether the rest can be mended: not in a store whose root is damaged.
        """
        problems = found.problems
        if _is_of_root(problems) and not self._mend_root():
            return False
        pieces = open_pieces(self._path)[0]
        with contextlib.suppress(GraspFactoryError):  # a damaged copy is mended from the cache
            carried.unpack(self._path, pieces.config)
        with self._template(pieces.config, pieces.attributes, pieces.rows) as template:
            damaged = [p.array for p in problems if p.episode is None and p.array]
            has_changed = self._mend_documents(template, pieces, damaged)
            self._remove_packed(damaged)
            self._remove_leftovers()
            pieces, unreadable = open_pieces(self._path)
            if unreadable:
                self.failed.append("rows stay as they are, for whole arrays cannot be read")
                return True
            if has_changed:  # what these arrays hold was not seen yet
                blocks = range(pieces.blocks)
                checked = check_blocks(pieces, blocks, self._workers, self._on_episode)
                problems = tuple(checked.problems)
            size = pieces.config.block_size
            broken = {p.episode // size for p in problems if p.episode is not None}
            self._mend_blocks(template, pieces, sorted(broken))
        return True

    def _mend_root(self) -> bool:
        """Make the root's metadata again; return whether that could be done.

        It is certain where what is left of it says what the whole one would say here and now.
        """
        place = self._path / FILE
        if has_config(self._path):
            left = read_document(place)[0]["attributes"]
            config = FactoryConfig.from_plain(left["config"])
            more = {"robot": check_names(config).facts()}
            more |= {key: left[key] for key in (SOURCES,) if key in left}
            with self._template(config, root_attributes(config, more), rows=0) as template:
                made = read_document(template.path / FILE)[0]["attributes"]
                if left.get(SEAL) == made[SEAL] or left == made | {SEAL: left.get(SEAL)}:
                    template.give_document("")
                    self.mended.append(f"{FILE} of the root is made again")
                    return True
        self.failed.append(f"{FILE} of the root cannot be made again: {COPY_ROOT}")
        return False

    def _template(
        self, config: FactoryConfig, attributes: Mapping[str, Any], rows: int
    ) -> Template:
        robot = check_names(config)
        try:
            objects = carried.packed(config)
        except ConfigError:  # this machine has not imported them
            objects = {}
        joints = len(robot.arm_joints)
        return Template(self._path, config, attributes, joints=joints, rows=rows, objects=objects)

    def _mend_documents(self, template: Template, pieces: Pieces, damaged: Iterable[str]) -> bool:
        """Make metadata and users' objects again; return whether any array's has changed."""
        other = template.differs(pieces.arrays)
        has_changed = False
        for name in damaged:
            if name == LABELS:
                template.give_empty_group(name)
            elif name.split("/")[0] in (LABELS, FOLDER):
                continue
            elif other:
                why = f"{FILE} of {other}, which is whole, is not as this version writes it"
                self.failed.append(f"{name}/{FILE} cannot be made again here: {why}")
                continue
            elif not (template.path / name / FILE).exists():
                how = "import its folder with grasp-factory objects DIR, and repair again"
                self.failed.append(f"{name} cannot be made again: {how}")
                continue
            else:
                template.give_document(name)
                if name.startswith(f"{GROUP}/"):
                    chunks = sorted((template.path / name).glob("[0-9]*"))
                    template.give_files(chunks)
                has_changed |= name in pieces.fields
            self.mended.append(f"{name}/{FILE} is made again")
        return has_changed

    def _remove_packed(self, damaged: Iterable[str]) -> None:
        """Remove packed segments that are damaged; all of them with the folder's metadata."""
        for segment in segments(self._path):
            if {FOLDER, f"{FOLDER}/{segment.file.name}"} & set(damaged):
                segment.file.unlink()
                self.mended.append(f"{FOLDER}/{segment.file.name} is removed; it is derived")
        if FOLDER in damaged:
            (self._path / FOLDER / FILE).unlink(missing_ok=True)
            fsync([self._path / FOLDER])

    def _remove_leftovers(self) -> None:
        for file in leftovers(self._path):
            shutil.rmtree(file) if file.is_dir() else file.unlink()
            name = file.relative_to(self._path)
            self.mended.append(f"{name} is removed: a run that was killed had left it")

    def _mend_blocks(self, template: Template, pieces: Pieces, blocks: list[int]) -> None:
        """Keep what is whole of these blocks, make the rest again, or leave it to the factory."""
        begun = [block for block in blocks if _is_begun(pieces, block)]
        for block in sorted(set(blocks) - set(begun)):
            self._leave(pieces, Mended(block=block, lost=tuple(pieces.rows_of(block))))

        def hear(message: int | Mended) -> None:
            if not isinstance(message, Mended):
                self._on_episode(message)
            elif message.lost:
                self._leave(pieces, message)
            else:  # put in its place at once: the template shall not grow
                unpack_block(self._path, message.block)
                template.give_files(files_of(template.path, pieces, message.block))
                self.remade += message.remade
                rows = pieces.rows_of(message.block)
                self.mended.append(f"rows {rows[0]} to {rows[-1]} are whole again")

        executor = executor_for(self._workers, len(begun), few=FEW)
        with contextlib.closing(BlockMender(self._path, template.path)) as mender:
            executor.run(mender, begun, hear)

    def _leave(self, pieces: Pieces, block: Mended) -> None:
        """Leave a block to the factory, which does not know those of collected stores."""
        if pieces.is_collected:
            what = "cannot be made again: nothing is left that tells the recipe"
            self.failed.append(f"rows {', '.join(map(str, block.lost))} {what}")
            return
        self.blocks.append(block.block)
        self.to_generate |= {i: block.known.get(i, "") for i in pieces.rows_of(block.block)}
        unpack_block(self._path, block.block)
        remove_marker(pieces, block.block)


def _is_of_root(problems: Iterable[Problem]) -> bool:
    """Say whether one of these is a problem of the root's own metadata."""
    return any(problem.episode is None and not problem.array for problem in problems)


def _is_begun(pieces: Pieces, block: int) -> bool:
    """Say whether there is anything of a block that may be kept."""
    rows = pieces.rows_of(block)
    fields = (schema.STATUS, schema.CHECKSUM)
    files = [block_files(pieces.path, field, block, rows)[0] for field in fields]
    return any(file.exists() for file in files)
