"""The recorded motion of an attempt: the positions of robot and objects at any time."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from grasp_factory.core.enums import Phase
from grasp_factory.core.episode import Episode
from grasp_factory.core.geometry import Array
from grasp_factory.dataset.plausible import check_motion
from grasp_factory.errors import lookup
from grasp_factory.robots import ROBOTS


@dataclass(frozen=True, slots=True, eq=False)
class Posture:
    """Where everything is at one instant."""

    joint_positions: Array
    """(J,) rad."""
    gripper_width: float
    """Metres."""
    objects: Array
    """(M, 7): position (m) and quat_xyzw of each object's own frame, world."""


@dataclass(frozen=True, slots=True, eq=False)
class Track:
    """The recorded motion, from the instant at which the arm started."""

    timestamp: Array
    """(K,) s; the first is 0, unless the episode is real."""
    joint_positions: Array
    """(K, J) rad."""
    gripper_width: Array
    """(K,) m."""
    objects: Array
    """(K, M, 7)."""

    @classmethod
    def of(cls, episode: Episode) -> Track:
        """Return an episode's motion: home and the objects' rest poses first, then its records.

        That of a real episode has its records alone.

        Raises:
            ConfigError: if its clocks or its joint positions are not those of an attempt.
        """
        model, streams = lookup(ROBOTS, "robot", episode.spec.robot), episode.streams
        check_motion(episode, len(model.home))
        if episode.is_real:
            names = ("timestamp", "joint_positions", "gripper_width", "object_pose")
            return cls(*(np.asarray(streams[name], np.float64) for name in names))
        return cls(
            np.concatenate([[0.0], streams["timestamp"]]),
            np.vstack([[model.home], streams["joint_positions"].astype(np.float64)]),
            np.concatenate([[model.gripper.max_width], streams["gripper_width"]]),
            np.concatenate([episode.columns["object_rest_pose"][None], streams["object_pose"]]),
        )

    @property
    def duration(self) -> float:
        """Seconds until the last record."""
        return float(self.timestamp[-1])

    def at(self, time: float) -> Posture:
        """Return the posture at a time (s), interpolated between two records."""
        last = len(self.timestamp) - 1
        i = min(max(int(np.searchsorted(self.timestamp, time, "right")) - 1, 0), max(last - 1, 0))
        j = min(i + 1, last)
        span = self.timestamp[j] - self.timestamp[i]
        share = min(max((time - self.timestamp[i]) / span, 0.0), 1.0) if span > 0.0 else 0.0
        return Posture(
            _between(self.joint_positions[i], self.joint_positions[j], share),
            float(_between(self.gripper_width[i], self.gripper_width[j], share)),
            _poses_between(self.objects[i], self.objects[j], share),
        )


def _between(a: Array, b: Array, share: float) -> Array:
    return np.asarray(a + share * (b - a), np.float64)


def _poses_between(a: Array, b: Array, share: float) -> Array:
    """Return poses (M, 7) interpolated between ``a`` and ``b``, which must be close together."""
    same_side = np.where((a[:, 3:] * b[:, 3:]).sum(axis=1, keepdims=True) < 0.0, -1.0, 1.0)
    quats = _between(a[:, 3:], b[:, 3:] * same_side, share)
    quats /= np.linalg.norm(quats, axis=1, keepdims=True)
    return np.hstack([_between(a[:, :3], b[:, :3], share), quats])


def phase_at(episode: Episode, time: float) -> str:
    """Return the name of an attempt's phase at a time (s); empty if it has no records."""
    if not episode.n_steps:
        return ""
    i = int(np.searchsorted(episode.streams["timestamp"], time))
    return Phase(int(episode.streams["phase"][min(i, episode.n_steps - 1)])).name.lower()
