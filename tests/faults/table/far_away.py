"""Faults of clusters and object storage: several writers, lost nodes, lost answers."""

from __future__ import annotations

from faults.fault import Fault

FAULTS = (
    Fault(
        "marker-sent-before-the-data",
        "curation/upload/uploading.py",
        "        put_once(objects, claim.inner, claim.read_bytes(OBJECT))\n",
        "        put_once(objects, claim.inner, claim.read_bytes(OBJECT))\n"
        "        _put(objects, marker)\n",
        ("curation/test_upload.py",),
    ),
    Fault(
        "block-sent-without-its-claim-first",
        "curation/upload/uploading.py",
        "        put_once(objects, claim.inner, claim.read_bytes(OBJECT))\n",
        "        data = [*data, claim]\n",
        ("curation/test_upload.py",),
    ),
    Fault(
        "claim-of-a-finished-block-not-compared",
        "curation/upload/uploading.py",
        "if is_marked and _is_same(objects, claim):",
        "if is_marked:",
        ("curation/test_upload.py",),
    ),
    Fault(
        "lost-answer-taken-for-another-writer",
        "core/object_storage/put_once.py",
        "                if is_there(objects, key, data):\n                    return False\n",
        "",
        ("curation/test_upload.py",),
    ),
    Fault(
        "another-content-of-the-same-size-accepted",
        "core/object_storage/put_once.py",
        "    return objects.part(key, 0, len(data)) == data\n",
        "    return True\n",
        ("curation/test_upload.py",),
    ),
    Fault(
        "report-of-a-lost-node-heard",
        "core/executors/cluster/coordinator.py",
        "            if answer is not None and answer.node in self._nodes:\n",
        "            if answer is not None and not isinstance(answer.content, NodeGone):\n"
        "                self._nodes.setdefault(answer.node, _Node(answer.node, now))\n",
        ("core/test_cluster.py",),
    ),
    Fault(
        "loss-of-a-block-not-counted",
        "core/executors/cluster/coordinator.py",
        'self._todo.append((place, self._recover(job, LostNode(f"its node is lost: {why}"))))',
        "self._todo.append((place, job))",
        ("core/test_cluster.py",),
    ),
    Fault(
        "later-claim-of-a-block-not-seen",
        "writers/zarr/block_attempt.py",
        "later = range(self._number + 1, MOST_CLAIMS + 1)",
        "later = range(0)",
        ("writers/test_block_races.py",),
    ),
)
