"""Checks that every real episode must pass: what was measured is possible, the rest is empty."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from grasp_factory.core.enums import UNKNOWN, Outcome
from grasp_factory.core.episode import EpisodeSpec
from grasp_factory.core.sensors import series_groups
from grasp_factory.curation.verify.problems import Fault
from grasp_factory.dataset.row_codec import Row
from grasp_factory.errors import shown
from grasp_factory.labels.quality import BEST, WORST

_SHORTEST_S = 1e-9
_UNIT = 1e-5
"""Tolerance of a quaternion's norm in single precision, and of a rotation matrix."""
_WITNESSES = ("label_gripper", "label_force")


def real_faults(contents: Row, spec: EpisodeSpec) -> Iterator[Fault]:
    """Yield each array of a real episode with an impossible value, and what is wrong.

    Args:
        contents: the episode's arrays by path, unpadded, without infinity.
        spec: its recipe, which has a recording.
    """
    yield from _recording_faults(contents, spec)
    yield from _clock_faults(contents)
    yield from _label_faults(contents)
    yield from _pose_faults(contents)
    for path, depth in contents.items():
        if path.endswith("/depth") and (depth <= 0.0).any():
            yield path, "a depth of 0 or less; not measured is NaN"
    quality = int(contents["episodes/quality"])
    if not WORST <= quality <= BEST:
        yield "episodes/quality", f"{quality}, valid: {WORST} to {BEST}"


def _recording_faults(contents: Row, spec: EpisodeSpec) -> Iterator[Fault]:
    source = spec.recording
    assert source
    wanted: dict[str, Any] = {
        "session": source.session,
        "recording": source.path,
        "started": source.start_ns / 1e9,
        "duration": (source.end_ns - source.start_ns) / 1e9,
        "calibration_sha256": source.calibration_sha256,
    }
    for name, value in wanted.items():
        got = contents[f"episodes/{name}"].tolist()
        if got != value:
            yield f"episodes/{name}", f"{shown(got)}, its recipe has {shown(value)}"


def _clock_faults(contents: Row) -> Iterator[Fault]:
    """Check that all times ascend and lie in the episode."""
    duration = float(contents["episodes/duration"])
    for group in series_groups():
        times = contents.get(f"{group.name}/timestamp")
        if times is None or not len(times):
            continue
        if (np.diff(times) < _SHORTEST_S / 2).any():
            yield f"{group.name}/timestamp", "does not ascend"
        if times[0] < 0.0 or times[-1] > duration + _SHORTEST_S:
            yield f"{group.name}/timestamp", f"not within 0 to {duration:g} s, the episode's time"


def _label_faults(contents: Row) -> Iterator[Fault]:
    """Check that the outcome follows from what the witnesses say."""
    outcome = int(contents["episodes/outcome"])
    operator, *others = (
        int(contents[f"episodes/{name}"]) for name in ("label_operator", *_WITNESSES)
    )
    told = [label for label in others if label != UNKNOWN]
    failures = [label for label in told if label != Outcome.SUCCESS]
    judged = operator if operator != UNKNOWN else next(iter(failures or told), UNKNOWN)
    if outcome != judged:
        yield "episodes/outcome", f"{outcome}, its labels give {judged}"
    is_success = outcome == Outcome.SUCCESS
    if bool(contents["episodes/success"]) != is_success:
        yield "episodes/success", f"{not is_success} for outcome {outcome}"
    reward = np.zeros(len(contents["streams/reward"]), np.float32)
    reward[-1:] = is_success
    if not np.array_equal(contents["streams/reward"], reward):
        yield "streams/reward", "is not 1 on the last record of a success alone"


def _pose_faults(contents: Row) -> Iterator[Fault]:
    """Check that poses are there as a whole, and are poses."""
    for path, values in contents.items():
        name = path.rsplit("/", 1)[-1]
        if name.startswith("T_"):
            known = values[np.isfinite(values).all(axis=(-2, -1))]
            if not _is_rigid(known):
                yield path, "no rigid transform"
        elif name in ("tcp_pose", "grasp_quat_xyzw"):
            quats = values[..., -4:].astype(np.float64).reshape(-1, 4)
            off = np.abs(np.linalg.norm(quats[np.isfinite(quats).all(axis=1)], axis=1) - 1.0)
            if (off > _UNIT).any():
                yield path, f"a quaternion that is not unit, by {off.max():.2g}"


def _is_rigid(T: NDArray[Any]) -> bool:
    R = T[..., :3, :3]
    off = np.abs(R @ np.swapaxes(R, -1, -2) - np.eye(3)).max(initial=0.0)
    is_last = (T[..., 3, :] == [0.0, 0.0, 0.0, 1.0]).all()
    return bool(off < _UNIT and (np.linalg.det(R) > 0.0).all() and is_last)
