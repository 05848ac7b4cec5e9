"""New labels from other thresholds, derived from the stored streams without simulating."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from grasp_factory.core.config.label import LabelConfig
from grasp_factory.core.enums import Outcome, Phase
from grasp_factory.core.serialization import to_plain
from grasp_factory.dataset.dataset import Dataset
from grasp_factory.errors import UsageError
from grasp_factory.labels.rule import judge
from grasp_factory.writers.zarr.label_columns import NOT_LABELLED, write_label
from grasp_factory.writers.zarr.lock import StoreLock

_STREAMS = (
    "timestamp",
    "phase",
    "shake_level",
    "tcp_pose",
    "object_pose",
    "tactile_position",
    "tactile_force",
    "tactile_normal",
    "tactile_depth",
    "tactile_body",
)


@dataclass(frozen=True, slots=True, kw_only=True)
class Relabelled:
    """How a new label compares with the store's own."""

    name: str
    episodes: int
    successes_before: int
    successes: int
    changed: int
    """Episodes whose outcome differs."""


def relabel(path: Path, name: str, thresholds: LabelConfig) -> Relabelled:
    """Add the label column ``name`` to a store; everything in it stays as it is.

    Attempts that ended before the gripper closed keep their outcome.

    Raises:
        UsageError: for a name that is taken, or a threshold beyond the attempts' shake or lift.
        StoreError: if the store is damaged, or another process is writing to it.
    """
    dataset = Dataset(path)
    strongest = max(dataset.config.shake.levels, default=0.0)
    if thresholds.min_shake > strongest:
        raise UsageError(
            f"min_shake: got {thresholds.min_shake}, valid: 0 to {strongest}, the strongest level"
            f" that {path} was shaken with"
        )
    lifted = dataset.config.motion.lift_height
    if thresholds.min_lift >= lifted:
        raise UsageError(
            f"min_lift: got {thresholds.min_lift}, valid: less than {lifted} m, which is how far"
            f" {path} was lifted"
        )
    with StoreLock(path):
        before = dataset.column("outcome")
        after = np.full(len(dataset), NOT_LABELLED, np.uint8)
        object_com, rest_height = dataset.column("object_com"), dataset.column("rest_height")
        for i in dataset.committed:
            streams = dataset.series(int(i), *_STREAMS)
            if (streams["phase"] == Phase.CLOSE).any():
                after[i] = judge(streams, object_com[i, 0], float(rest_height[i]), thresholds)
            else:
                after[i] = before[i]
        write_label(path, name, after, to_plain(thresholds))
    return Relabelled(
        name=name,
        episodes=len(dataset.committed),
        successes_before=int((before == Outcome.SUCCESS).sum()),
        successes=int((after == Outcome.SUCCESS).sum()),
        changed=int((before != after)[dataset.committed].sum()),
    )
