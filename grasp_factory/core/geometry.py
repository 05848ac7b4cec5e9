"""Rigid transforms, rotations and quaternions.

``T_a_b`` maps coordinates in frame b to frame a; quaternions are xyzw (scalar last).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from grasp_factory.core.elementary import arctan2, sincos
from grasp_factory.core.linear import Array as Array  # noqa: PLC0414
from grasp_factory.core.linear import length, norm, product, turned
from grasp_factory.core.vectors import QuatXyzw as QuatXyzw  # noqa: PLC0414
from grasp_factory.core.vectors import Vector3 as Vector3  # noqa: PLC0414


@dataclass(frozen=True, slots=True)
class Pose:
    """A position and an orientation, as plain tuples so that poses compare and hash."""

    position: tuple[float, float, float]
    """Metres."""
    quat_xyzw: tuple[float, float, float, float]
    """Unit quaternion, scalar last."""

    @classmethod
    def from_matrix(cls, T: ArrayLike) -> Pose:
        """Return the pose of a homogeneous transform, shape (4, 4)."""
        T = np.asarray(T, dtype=np.float64)
        return cls(_tuple3(T[:3, 3]), _tuple4(matrix_to_quat_xyzw(T[:3, :3])))

    def matrix(self) -> Array:
        """Return the homogeneous transform, shape (4, 4)."""
        return transform(quat_xyzw_to_matrix(self.quat_xyzw), self.position)


IDENTITY = Pose((0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0))


def transform(R: ArrayLike, position: ArrayLike) -> Array:
    """Return the homogeneous transform of a rotation (3, 3) and a position (3,) in metres."""
    T = np.eye(4)
    T[:3, :3] = R
    T[:3, 3] = position
    return T


def inverse(T: Array) -> Array:
    """Return the inverse of rigid transforms, shape (..., 4, 4)."""
    out = np.zeros_like(T)
    Rt = np.swapaxes(T[..., :3, :3], -1, -2)
    out[..., :3, :3] = Rt
    out[..., :3, 3] = -turned(Rt, T[..., :3, 3])
    out[..., 3, 3] = 1.0
    return out


def apply(T: Array, points: Array) -> Array:
    """Return points, shape (..., 3) in metres, mapped by one transform (4, 4)."""
    return turned(T[:3, :3], points) + T[:3, 3]


def rotation_about(axis: ArrayLike, angle: float) -> Array:
    """Return the rotation matrix (3, 3) of ``angle`` radians about a unit ``axis`` (3,).

    Rodrigues' formula.
    """
    K = skew(np.asarray(axis, dtype=np.float64))
    sine, cosine = sincos(angle)
    return np.asarray(np.eye(3) + sine * K + (1.0 - cosine) * product(K, K))


def rotation_of_rpy(rpy: ArrayLike) -> Array:
    """Return the rotation (3, 3) by roll, pitch, yaw in rad, as in URDF: about fixed axes."""
    (roll, pitch, yaw), (x, y, z) = np.asarray(rpy, dtype=np.float64), np.eye(3)
    return product(
        product(rotation_about(z, yaw), rotation_about(y, pitch)), rotation_about(x, roll)
    )


def skew(v: Array) -> Array:
    """Return the matrix (3, 3) of the cross product with ``v`` (3,)."""
    x, y, z = v
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])


def rotation_vector(R: Array) -> Array:
    """Return axis times angle (3,) of a rotation matrix (3, 3); the angle is in [0, pi] rad."""
    x, y, z, w = matrix_to_quat_xyzw(R)
    v = np.array([x, y, z])
    sine = length(v)
    if sine < 1e-12:
        return 2.0 * v
    return np.asarray(v / sine * 2.0 * arctan2(sine, w))


def quat_xyzw_to_matrix(quat_xyzw: ArrayLike) -> Array:
    """Return rotation matrices (..., 3, 3) of quaternions (..., 4), which need not be unit."""
    quat = np.asarray(quat_xyzw, dtype=np.float64)
    x, y, z, w = (quat / norm(quat)[..., None]).T
    rows = np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )
    return np.ascontiguousarray(rows.T.swapaxes(-1, -2))


def pose_matrices(poses: ArrayLike) -> Array:
    """Return homogeneous transforms (..., 4, 4) of poses (..., 7): position (m) and quat_xyzw."""
    poses = np.asarray(poses, dtype=np.float64)
    T = np.zeros((*poses.shape[:-1], 4, 4))
    T[..., :3, :3] = quat_xyzw_to_matrix(poses[..., 3:])
    T[..., :3, 3] = poses[..., :3]
    T[..., 3, 3] = 1.0
    return T


def matrix_to_quat_xyzw(R: ArrayLike) -> Array:
    """Return the unit quaternion (4,) with w >= 0 of a rotation matrix (3, 3).

    Shepperd's method: it divides by the largest component, so it is well-conditioned at all angles.
    """
    R = np.asarray(R, dtype=np.float64)
    trace = R[0, 0] + R[1, 1] + R[2, 2]
    squares = np.array([1 + 2 * R[0, 0] - trace, 1 + 2 * R[1, 1] - trace,
                        1 + 2 * R[2, 2] - trace, 1 + trace])  # fmt: skip
    largest = int(np.argmax(squares))
    if largest == 3:
        q = np.array([R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1], squares[3]])
    else:
        i, j, k = largest, (largest + 1) % 3, (largest + 2) % 3
        q = np.zeros(4)
        q[i], q[j], q[k] = squares[i], R[j, i] + R[i, j], R[k, i] + R[i, k]
        q[3] = R[k, j] - R[j, k]
    q /= norm(q)
    return -q if q[3] < 0 else q


def look_at(eye: ArrayLike, target: ArrayLike, up: ArrayLike = (0.0, 0.0, 1.0)) -> Array:
    """Return ``T_world_camera`` (4, 4) in OpenCV axes: +x right, +y down, +z towards target.

    Raises:
        ValueError: if the viewing direction is parallel to ``up`` or has no length.
    """
    eye = np.asarray(eye, dtype=np.float64)
    forward = np.asarray(target, dtype=np.float64) - eye
    right = np.cross(forward, np.asarray(up, dtype=np.float64))
    if length(right) < 1e-9:
        raise ValueError(f"no camera looks from {eye!r} to {target!r} with up {up!r}: change up")
    forward /= norm(forward)
    right /= norm(right)
    return transform(np.column_stack([right, np.cross(forward, right), forward]), eye)


def _tuple3(v: Array) -> tuple[float, float, float]:
    x, y, z = (float(a) for a in v)
    return x, y, z


def _tuple4(v: Array) -> tuple[float, float, float, float]:
    x, y, z, w = (float(a) for a in v)
    return x, y, z, w
