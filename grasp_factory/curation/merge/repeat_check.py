"""The check of episodes that several stores have: they must be the same."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from grasp_factory.curation.merge.source_store import SourceStore
from grasp_factory.curation.merge.union import Union
from grasp_factory.errors import StoreMismatchError


def check_repeats(sources: Sequence[SourceStore], found: Union) -> None:
    """Check that rows that several stores have are the same.

    One store may have quarantined an episode that another store has committed: the death of a
    worker does not prove that the episode cannot be made.

    Raises:
        StoreMismatchError: naming an episode that differs, and both stores.
    """
    left_out, kept = found.repeats
    involved = np.unique(np.concatenate([left_out.store, kept.store])).tolist()
    checksums = {k: sources[k].checksums() for k in involved}
    for k in involved:
        for twin in involved:
            pair = np.flatnonzero((left_out.store == k) & (kept.store == twin))
            mine = checksums[k][left_out.row[pair]]
            alike = sources[k].status[left_out.row[pair]] == sources[twin].status[kept.row[pair]]
            other = alike & (mine != checksums[twin][kept.row[pair]])
            if other.any():
                bad = left_out[pair[other][:1]]
                raise StoreMismatchError(
                    f"episode {bad.index[0]} of seed {bad.seed[0]} is not the same in"
                    f" {sources[twin].path} and {sources[k].path}: `grasp-factory verify` says"
                    " whether one is damaged; if none is, they come from two platforms: leave one"
                    " of these stores out"
                )
