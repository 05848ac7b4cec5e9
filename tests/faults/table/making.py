"""Faults in the rooms ``factory`` and ``curation``: making stores, checking and changing them."""

from __future__ import annotations

from faults.fault import Fault

FAULTS = (
    Fault(
        "shards-share-blocks",
        "factory/block_job.py",
        "request.shard.has(rows // size)",
        "request.shard.has(rows)",
        ("factory/test_shards.py",),
    ),
    Fault(
        "parts-are-not-joined",
        "curation/upload/stages.py",
        "together=block_size if request.shard.count > 1 else 0",
        "together=0",
        ("curation/test_remote_parts.py",),
    ),
    Fault(
        "stages-leave-blocks-out",
        "curation/upload/stages.py",
        "range(first, count, shard.count)",
        "range(first, count, 2 * shard.count)",
        ("curation/test_remote_parts.py",),
    ),
    Fault(
        "resume-skips-partial-blocks",
        "factory/generate.py",
        "blocks = np.unique(wanted // size)",
        "blocks = np.unique(wanted[::size] // size)",
        ("factory/test_resume.py", "factory/test_generate.py"),
    ),
    Fault(
        "one-try-too-many",
        "factory/retry_policy.py",
        "TRIES_OF_EPISODE = 2",
        "TRIES_OF_EPISODE = 3",
        ("factory/test_retry_policy.py",),
    ),
    Fault(
        "results-in-the-order-of-arrival",
        "core/executors/job_round.py",
        "return [self._results[place] for place in range(len(self._results))]",
        "return list(self._results.values())",
        ("conformance/test_executors.py", "core/test_executors.py"),
    ),
    Fault(
        "quarantine-wins-in-a-merge",
        "curation/merge/union.py",
        "np.lexsort((store, is_quarantined, index, first[which]))",
        "np.lexsort((store, index, first[which]))",
        ("curation/test_merge.py",),
    ),
    Fault(
        "repeated-rows-lose-their-annotations",
        "curation/merge/annotation_transfer.py",
        "return found | {row: places[twin] for row, twin in twins}",
        "return found",
        ("curation/test_merge.py", "dataset/test_annotations.py"),
    ),
    Fault(
        "merge-not-read-back",
        "curation/merge/building.py",
        "if found != wanted:",
        "if len(found) != len(wanted):",
        ("curation/test_merge.py",),
    ),
    Fault(
        "first-padded-value-not-verified",
        "curation/verify/contents.py",
        "np.atleast_1d(value)[kept[path] :]",
        "np.atleast_1d(value)[kept[path] + 1 :]",
        ("curation/test_verify.py",),
    ),
    Fault(
        "outcome-not-derived-again",
        "curation/verify/derived_values.py",
        "if outcome != judged:",
        "if outcome not in set(Outcome):",
        ("curation/test_verify.py",),
    ),
)
