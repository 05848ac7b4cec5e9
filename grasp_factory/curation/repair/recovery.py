"""The intact parts of a damaged row, and the recipe to make it again."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass

from grasp_factory.core import schema
from grasp_factory.core.config.factory_config import FactoryConfig
from grasp_factory.core.episode import Episode, EpisodeSpec
from grasp_factory.curation.verify.contents import is_complete, is_whole, trimmed
from grasp_factory.curation.verify.invariants import faults
from grasp_factory.curation.verify.partial_store import PartialStore
from grasp_factory.dataset.row_codec import Row, assemble
from grasp_factory.dataset.row_integrity import QUARANTINE_PATHS, mismatched, quarantine_checksum
from grasp_factory.errors import GraspFactoryError
from grasp_factory.sampling.spec import sample_spec
from grasp_factory.writers.base import Quarantined

_RECIPE = ("episodes/spec", "episodes/seed", "episodes/index")


@dataclass(frozen=True, slots=True)
class Recipe:
    """How to make a row again."""

    config: FactoryConfig
    index: int
    """Number of the row among those that are sampled with the config."""
    stored: EpisodeSpec | None = None
    """The row's own recipe, if it is the one to follow."""

    @property
    def is_real(self) -> bool:
        """Whether the row is a real episode, which cannot be simulated."""
        return bool(self.stored and self.stored.recording)

    def spec(self) -> EpisodeSpec:
        """Return the recipe; sampling it takes as long as reading the row."""
        return self.stored or sample_spec(self.config, self.index)


def recovered(row: Row, pieces: PartialStore, i: int) -> Episode | Quarantined | None:
    """Return a row as it was written, regardless of its stored status; None if it is lost.

    An episode is kept if it matches the row's checksum, or if each array matches its digest.
    """
    return _episode(row, pieces, i) or _quarantined(row, pieces, i)


def recipe(row: Row, pieces: PartialStore, i: int) -> Recipe | None:
    """Return the recipe of a row; None if it cannot be recovered.

    In a generated store it follows from the row's number. In a merged store, and in one that may
    hold real episodes, it is the row's own recipe, or follows from the row's seed and index. Values
    count only if they match their digests or each other.
    """
    if not pieces.is_collected and pieces.config.capture is None:
        return Recipe(pieces.config, i)
    sound = _sound(row, pieces)
    seed, index = (int(row.get(path, _NONE)) for path in _RECIPE[1:])
    try:
        spec = EpisodeSpec.from_json(str(row["episodes/spec"]))
    except (KeyError, ValueError, RecursionError):
        spec = None
    if spec and ("episodes/spec" in sound or (spec.seed, spec.index) == (seed, index)):
        return Recipe(pieces.config, spec.index, spec)
    may_be_real = pieces.config.capture is not None
    if {"episodes/seed", "episodes/index"} <= sound and min(seed, index) >= 0 and not may_be_real:
        return Recipe(dataclasses.replace(pieces.config, seed=seed), index)
    return None


_NONE = -1


def _episode(row: Row, pieces: PartialStore, i: int) -> Episode | None:
    contents = trimmed(row, pieces.fields)
    if not is_complete(contents, pieces):
        return None
    if not is_whole(row, contents, pieces) and not _sound(row, pieces) >= set(contents):
        return None
    if next(faults(contents, pieces, i), None):
        return None
    try:
        return assemble(contents, pieces.config.cameras)
    except (KeyError, TypeError, ValueError, RecursionError):
        return None


def _quarantined(row: Row, pieces: PartialStore, i: int) -> Quarantined | None:
    if not all(path in row for path in (*QUARANTINE_PATHS, schema.CHECKSUM.path)):
        return None
    if quarantine_checksum(row) != str(row[schema.CHECKSUM.path]):
        return None
    try:
        spec = EpisodeSpec.from_json(str(row["episodes/spec"]))
    except (GraspFactoryError, ValueError, RecursionError):
        return None
    if not pieces.is_collected and (spec.seed, spec.index) != (pieces.config.seed, i):
        return None
    return Quarantined(spec, str(row[schema.ERROR.path]))


def _sound(row: Row, pieces: PartialStore) -> set[str]:
    """Return the paths of the values that match their digests."""
    if schema.DIGESTS.path not in row:
        return set()
    contents = trimmed(row, pieces.fields)
    differs = mismatched(contents, pieces.digested, row[schema.DIGESTS.path])
    return {path for path in differs if not differs[path]}
