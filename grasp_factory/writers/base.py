"""The interface of all writers: each stores blocks of consecutive episodes."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from grasp_factory.core.episode import Episode, EpisodeSpec
from grasp_factory.core.schema import ERROR
from grasp_factory.errors import StoreError


@dataclass(frozen=True, slots=True)
class Quarantined:
    """An episode that could not be made: its recipe and the reason, in place of its data."""

    spec: EpisodeSpec
    reason: str
    """One line, the same for the same recipe: it is part of the dataset's bytes."""

    def contents(self) -> dict[str, NDArray[Any]]:
        """Return the arrays that a store keeps of it, by path; its checksum covers these."""
        return {
            "episodes/spec": np.asarray(self.spec.to_json()),
            "episodes/seed": np.asarray(self.spec.seed, np.int64),
            "episodes/index": np.asarray(self.spec.index, np.int64),
            ERROR.path: np.asarray(self.reason.encode(errors="replace").decode()),
        }


class Writer(ABC):
    """Takes finished blocks. One instance per process; a block has one owner at a time."""

    @abstractmethod
    def write_block(
        self,
        block: int,
        rows: Sequence[Episode | Quarantined],
        fingerprints: Sequence[str] = (),
    ) -> None:
        """Replace block ``block`` by these rows, all of them or none.

        Args:
            block: number of the block; its first episode is ``block * block_size``.
            rows: consecutive episodes from the block's first one on.
            fingerprints: for each row the text of the platform that made it, empty if that is
                unknown; an empty sequence if it is unknown for all rows.

        Raises:
            StoreError: if the rows are not of this kind, or do not fit the arrays of the writer.
        """


def check_rows(block: int, rows: Sequence[Episode | Quarantined], first: int, most: int) -> None:
    """Check that ``rows`` are 1 to ``most`` consecutive episodes, starting with ``first``.

    Raises:
        StoreError: naming the block, the indices it got and the valid ones.
    """
    got = [row.spec.index for row in rows]
    if not got or got != list(range(first, first + min(len(got), most))):
        valid = f"1 to {most} consecutive episodes from {first} on"
        raise StoreError(f"block {block}: got episodes {got}, valid: {valid}")


def check_count(block: int, rows: Sequence[Episode | Quarantined], most: int) -> None:
    """Check that there are 1 to ``most`` rows; their recipes may have any indices.

    Raises:
        StoreError: naming the block, how many it got and what is valid.
    """
    if not 1 <= len(rows) <= most:
        raise StoreError(f"block {block}: got {len(rows)} episodes, valid: 1 to {most}")


def texts_of(rows: Sequence[Episode | Quarantined], fingerprints: Sequence[str]) -> tuple[str, ...]:
    """Return a fingerprint's text for each row; empty texts if ``fingerprints`` is empty.

    Raises:
        StoreError: if the number of texts is neither 0 nor that of the rows.
    """
    if len(fingerprints) not in (0, len(rows)):
        raise StoreError(f"{len(fingerprints)} fingerprints for {len(rows)} rows")
    return tuple(fingerprints) or ("",) * len(rows)
