"""Distances between two episodes of one recipe: the recorded one and its replay elsewhere.

Nothing here affects stored bytes.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from grasp_factory.core.episode import CameraFrames, Episode
from grasp_factory.core.geometry import Array

Arrays = Mapping[str, NDArray[Any]]
MILLI = 1000.0


@dataclass(frozen=True, slots=True, kw_only=True)
class PoseDistance:
    """Distance between poses; None if one of the episodes has no pose."""

    mm: float | None
    degrees: float | None


@dataclass(frozen=True, slots=True, kw_only=True)
class ImageDistance:
    """How a camera's images differ, before and after the attempt together."""

    pixels: int
    differing: int
    """Pixels with another colour, depth or label."""
    share: float
    """Differing pixels as a share of all pixels."""
    depth_median_mm: float
    """Median difference of the pixels whose depth differs; 0 if no depth differs."""
    depth_p99_mm: float
    """The 99th percentile of the same differences."""


@dataclass(frozen=True, slots=True, kw_only=True)
class EpisodeDistance:
    """How far apart two episodes are."""

    recorded: str
    """Outcome."""
    replayed: str
    steps_recorded: int
    """Records in each stream."""
    steps_replayed: int
    steps_differing: int
    """Records in which any stream differs, and records that only one episode has."""
    objects_at_end: PoseDistance
    """Largest distance of any object at the last record, or at rest if nothing was recorded."""
    objects_largest: PoseDistance
    """Largest distance of any object in any record that both have; mm and degrees separately."""
    tcp_at_end: PoseDistance
    tcp_largest: PoseDistance
    cameras: Mapping[str, ImageDistance]


def episode_distance(recorded: Episode, replayed: Episode) -> EpisodeDistance:
    """Return how far apart two episodes of one recipe are."""
    pair = (recorded, replayed)
    objects, tcp = (
        [np.asarray(e.streams[name], np.float64) for e in pair]
        for name in ("object_pose", "tcp_pose")
    )
    return EpisodeDistance(
        recorded=recorded.outcome.name.lower(),
        replayed=replayed.outcome.name.lower(),
        steps_recorded=recorded.n_steps,
        steps_replayed=replayed.n_steps,
        steps_differing=_differing_steps(recorded.streams, replayed.streams),
        objects_at_end=_pose_distance(*(_last_objects(e) for e in pair)),
        objects_largest=_pose_distance(*_common(*objects)),
        tcp_at_end=_pose_distance(*(poses[-1:] for poses in tcp)),
        tcp_largest=_pose_distance(*_common(*tcp)),
        cameras={
            name: _image_distance(frames, replayed.cameras[name])
            for name, frames in recorded.cameras.items()
            if name in replayed.cameras
        },
    )


def first_different(before: Arrays, after: Arrays) -> str:
    """Return the first array, by path, that is not the same byte for byte, and how it differs."""
    for path in sorted({*before, *after}):
        if path not in after:
            return f"{path} is missing in the replay"
        if path not in before:
            return f"{path} is missing in the store"
        a, b = before[path], after[path]
        if (a.shape, a.dtype) != (b.shape, b.dtype):
            return f"{path}: {a.dtype} {a.shape} against {b.dtype} {b.shape}"
        if a.tobytes() != b.tobytes():
            return f"{path}: {_how_far(a, b)}"
    return ""


def _how_far(a: NDArray[Any], b: NDArray[Any]) -> str:
    if a.dtype.kind not in "fiub":
        return f"{a!s:.60} against {b!s:.60}"
    a, b = a.astype(np.float64), b.astype(np.float64)
    same = np.isclose(a, b, rtol=0.0, atol=0.0, equal_nan=True)
    most = np.nanmax(np.abs(a - b), initial=0.0)
    return f"{int((~same).sum())} of {a.size} values differ, by {most:.3g} at most"


def _common(a: Array, b: Array) -> tuple[Array, Array]:
    steps = min(len(a), len(b))
    return a[:steps], b[:steps]


def _last_objects(episode: Episode) -> Array:
    """Return the objects' poses at the end, (M, 7)."""
    poses = episode.streams["object_pose"]
    last = poses[-1] if len(poses) else episode.columns["object_rest_pose"]
    return np.asarray(last, np.float64)


def _pose_distance(a: Array, b: Array) -> PoseDistance:
    """Return the largest distances of poses, (..., 7); poses that are NaN are ignored."""
    if a.shape != b.shape:
        return PoseDistance(mm=None, degrees=None)
    away = np.sqrt(((a[..., :3] - b[..., :3]) ** 2).sum(axis=-1))
    p, q = a[..., 3:], b[..., 3:]
    # q and -q are the same rotation: take the shorter chord, exactly 0 for equal quaternions.
    chord = np.minimum(*(np.sqrt(((p - sign * q) ** 2).sum(axis=-1)) for sign in (1.0, -1.0)))
    turn = np.degrees(4.0 * np.arcsin(np.minimum(chord / 2.0, 1.0)))
    return PoseDistance(mm=_largest(MILLI * away), degrees=_largest(turn))


def _largest(values: Array) -> float | None:
    there = values[np.isfinite(values)]
    return float(there.max()) if there.size else None


def _differing_steps(recorded: Arrays, replayed: Arrays) -> int:
    lengths = [len(streams["timestamp"]) for streams in (recorded, replayed)]
    common, longest = min(lengths), max(lengths)
    differs = np.zeros(common, np.bool_)
    for name in recorded.keys() & replayed.keys():
        a, b = (_bytes(streams[name][:common]) for streams in (recorded, replayed))
        differs |= (a != b).any(axis=1) if a.shape == b.shape else True
    return int(differs.sum()) + longest - common


def _bytes(values: NDArray[Any]) -> NDArray[np.uint8]:
    """Return the bytes of each record, (T, bytes)."""
    width = math.prod(values.shape[1:])
    return np.ascontiguousarray(values).reshape(len(values), width).view(np.uint8)


def _image_distance(a: CameraFrames, b: CameraFrames) -> ImageDistance:
    off = np.abs(a.depth.astype(np.float64) - b.depth) * MILLI
    differs = (a.rgb != b.rgb).any(axis=-1) | (a.segmentation != b.segmentation) | (off != 0.0)
    far = off[off > 0.0]
    median, p99 = np.percentile(far, (50.0, 99.0)) if far.size else (0.0, 0.0)
    return ImageDistance(
        pixels=differs.size,
        differing=int(differs.sum()),
        share=float(differs.mean()),
        depth_median_mm=float(median),
        depth_p99_mm=float(p99),
    )
