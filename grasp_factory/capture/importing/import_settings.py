"""Settings of the import of a session; they are part of every episode's recipe."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import IntEnum

import numpy as np

from grasp_factory.capture.calibration.kalibr import Matrix4
from grasp_factory.capture.quality.session_quality import SessionQualityConfig
from grasp_factory.core.serialization import check, check_range, normalise

_RIGID = 1e-6


class CutMethod(IntEnum):
    """What says where episodes begin and end."""

    EVENTS = 0
    """Events ``episode_start`` and ``episode_end``, or pairs of ``mark``."""
    GRIPPER = 1
    """The gripper: from before it begins to close until after it begins to open."""
    LIST = 2
    """A list of times."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ImportSettings:
    """How episodes are cut from a session, and how their labels are derived."""

    cut: CutMethod = CutMethod.EVENTS
    before_s: float = 2.0
    """Seconds before the gripper begins to close, with cut: gripper."""
    after_s: float = 0.5
    """Seconds after it begins to open."""
    min_stroke_m: float = 0.01
    """Smallest change of the gripper's width that counts as closing or opening, m."""
    min_width_m: float = 0.004
    """A closed gripper that is wider than this holds something, m."""
    min_weight_n: float = 0.5
    """Smallest change of the force at the wrist that counts as a weight in the hand, N."""
    window_s: float = 0.3
    """Seconds over which the force is averaged, before the closing and at the end."""
    max_gap_s: float = 0.1
    """Longest time between two samples that is bridged by interpolation, seconds."""
    cameras: Mapping[str, str] = field(default_factory=dict)
    """Camera of the store to device of the session; others are devices of the same name."""
    T_world_camera: Mapping[str, Matrix4] = field(default_factory=dict)
    """Pose of each camera of the store that stands still and is calibrated, OpenCV axes, m."""
    imu: str = ""
    """Device; empty for the first of its kind, as for the next three."""
    force_torque: str = ""
    tactile: str = ""
    joints: str = ""
    object: str = ""
    """What is grasped, if the events do not say it."""
    kinematics: bool = False
    """Whether the arm is the config's robot, so that the TCP pose follows from its joints."""
    latency_s: Mapping[str, float] = field(default_factory=dict)
    """Delay of each device's fastest samples, seconds, from a calibration."""
    quality: SessionQualityConfig = field(default_factory=SessionQualityConfig)

    def __post_init__(self) -> None:
        """Check the values.

        Raises:
            ConfigError: naming the setting.
        """
        normalise(self)
        check_range(self, "before_s", 0.0, 60.0, "s")
        check_range(self, "after_s", 0.0, 60.0, "s")
        check_range(self, "min_stroke_m", 0.001, 1.0, "m")
        check_range(self, "min_width_m", 0.0, 1.0, "m")
        check_range(self, "min_weight_n", 0.01, 1000.0, "N")
        check_range(self, "window_s", 0.01, 10.0, "s")
        check_range(self, "max_gap_s", 0.001, 10.0, "s")
        for name, latency in self.latency_s.items():
            check(0.0 <= latency <= 10.0, f"latency_s.{name}", latency, "0 to 10 s")
        for name, matrix in self.T_world_camera.items():
            T = np.array(matrix)
            off = np.abs(T[:3, :3] @ T[:3, :3].T - np.eye(3)).max()
            is_rigid = off < _RIGID and np.linalg.det(T[:3, :3]) > 0.0
            ok = bool(is_rigid) and T[3].tolist() == [0.0, 0.0, 0.0, 1.0]
            check(ok, f"T_world_camera.{name}", matrix, "a rotation and a translation")
