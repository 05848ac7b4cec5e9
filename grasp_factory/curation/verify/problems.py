"""The results of verifying: problems with advice, notes, and the report that contains them."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

from grasp_factory.core.text_format import count
from grasp_factory.curation.signing import FOLDER, SignatureReport
from grasp_factory.curation.versions.agreement import SnapshotReport
from grasp_factory.dataset.snapshots.snapshot_folder import SHORT

REPAIR = "run grasp-factory repair"
"""Advice for data that can be rebuilt."""
GENERATE = "run its generate command again, or grasp-factory repair"
"""Advice for rows that are missing."""
ASK = "get the store from its maker again, or ask for a new signature"
"""Advice for a store that is not as it was signed."""
LOOK = "grasp-factory diff says more"
"""Advice for a store that is not as in a snapshot."""
Fault = tuple[str, str]
"""Path of an array of an episode, and what is wrong with it."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Problem:
    """Something that is not as it was written, or cannot be true."""

    episode: int | None
    """The row; None for a problem of the whole store."""
    array: str
    """Path of the array or group in the store, or of a file; empty for the root."""
    what: str
    advice: str = REPAIR

    def __str__(self) -> str:
        where = "store" if self.episode is None else f"episode {self.episode}"
        array = f", {self.array}" if self.array else ""
        return f"{where}{array}: {self.what}; {self.advice}"


@dataclass(frozen=True, slots=True, kw_only=True)
class VerifyReport:
    """The result of verifying a store."""

    path: str
    episodes: int
    """Rows of the store."""
    committed: int
    quarantined: int
    missing: int
    problems: tuple[Problem, ...]
    notes: tuple[str, ...]
    """Harmless findings."""
    changed: tuple[str, ...]
    """Versions and platform facts that differ from those that the store was made with."""
    simulated: tuple[int, ...] = ()
    """Episodes that were simulated again."""
    deep_seed: int | None = None
    """Seed with which these episodes were drawn."""

    @property
    def is_whole(self) -> bool:
        """True when there is no problem."""
        return not self.problems

    def with_signature(self, found: SignatureReport, key: Path) -> VerifyReport:
        """Return the report with what the signature by the owner of a key says of the store."""
        problems = [
            Problem(episode=None, array=FOLDER, what=what, advice=ASK) for what in found.problems
        ]
        note = f"{count(found.files, 'file')} as the owner of {key} signed them"
        notes = (*self.notes, note) if found.files else self.notes
        return replace(self, problems=(*self.problems, *problems), notes=notes)

    def with_snapshot(self, found: SnapshotReport) -> VerifyReport:
        """Return the report with what a snapshot says of the store."""
        problems = [
            Problem(episode=row, array="", what=what, advice=LOOK) for row, what in found.problems
        ]
        notes = [*self.notes, *found.notes]
        if not problems:
            notes.append(f"all rows of snapshot {found.id[:SHORT]} are as they were")
        return replace(self, problems=(*self.problems, *problems), notes=tuple(notes))
