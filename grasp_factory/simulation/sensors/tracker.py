"""Ground truth of the objects' motion."""

from __future__ import annotations

from array import array
from typing import Any

import numpy as np
from numpy.typing import NDArray

from grasp_factory.core.geometry import Array, Pose
from grasp_factory.core.linear import dot
from grasp_factory.simulation.scene import Scene
from grasp_factory.simulation.sensors.base import Sensor, Tick


class ObjectTracker(Sensor):
    """The pose of every object's own frame."""

    def __init__(self, scene: Scene) -> None:
        self._world, self._bodies = scene.world, scene.objects
        self._rows = array("d")

    def sample(self, tick: Tick) -> None:
        """Read the poses."""
        for body in self._bodies:
            position, quat = self._world.com_frame(body)
            self._rows.extend((*position, *quat))

    def arrays(self) -> dict[str, NDArray[Any]]:
        """Return ``object_pose`` (samples, M, 7)."""
        poses = np.array(self._rows, np.float64).reshape(-1, len(self._bodies), 7)
        for m, body in enumerate(self._bodies):
            frame = self._world.inertial_frame(body)
            poses[:, m] = _com_to_object(poses[:, m], frame)
        return {"object_pose": poses.astype(np.float32)}


def _com_to_object(poses: Array, com: Pose) -> Array:
    """Return object frames (S, 7) for inertial frames (S, 7) that are at ``com`` in the object."""
    x, y, z, w = com.quat_xyzw
    quat = _multiply(poses[:, 3:], np.array([-x, -y, -z, w]))
    offset = _rotate(quat, np.array(com.position))
    return np.hstack([poses[:, :3] - offset, quat])


def _multiply(a: Array, b: Array) -> Array:
    """Return the quaternion products a * b of (S, 4) and (4,), xyzw."""
    av, aw, bv, bw = a[:, :3], a[:, 3:], b[:3], b[3]
    vector = aw * bv + bw * av + np.cross(av, bv)
    return np.hstack([vector, aw * bw - dot(av, bv)[:, None]])


def _rotate(quat: Array, v: Array) -> Array:
    """Return v (3,) rotated by each unit quaternion (S, 4), shape (S, 3)."""
    t = 2.0 * np.cross(quat[:, :3], v)
    return np.asarray(v + quat[:, 3:] * t + np.cross(quat[:, :3], t))
