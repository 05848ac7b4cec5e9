"""Forward kinematics of a serial chain of revolute joints read from a URDF file."""

from __future__ import annotations

import dataclasses
from collections.abc import Container
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

import numpy as np
from numpy.typing import ArrayLike

from grasp_factory.core.elementary import arctan2, sincos
from grasp_factory.core.geometry import (
    Array,
    inverse,
    rotation_about,
    rotation_of_rpy,
    transform,
)
from grasp_factory.core.linear import length, product, total


@dataclass(frozen=True, eq=False)
class Chain:
    """The n revolute joints between a base link and a tip; q are joint angles (..., n)."""

    joint_names: tuple[str, ...]
    """Names of the n revolute joints, from base to tip."""
    lower: Array
    """Lower joint limits in rad, shape (n,)."""
    upper: Array
    """Upper joint limits in rad, shape (n,)."""
    velocity_limits: Array
    """Largest joint speeds in rad/s, shape (n,)."""
    T_previous_joint: Array
    """Pose of each joint's frame at angle 0 in the frame of the previous joint; +z is its axis.

    Shape (n, 4, 4); the first is in the base frame.
    """
    T_joint_tip: Array
    """Pose of the tip in the frame of the last joint, shape (4, 4)."""

    @classmethod
    def from_urdf(cls, path: str | Path, base_link: str, tip_link: str) -> Chain:
        """Return the chain from ``base_link`` to ``tip_link``; fixed joints become offsets.

        Raises:
            ValueError: if the links are not connected by fixed joints and revolute joints with
                limits only.
        """
        names: list[str] = []
        limits: list[tuple[float, float, float]] = []
        offsets: list[Array] = []
        T = np.eye(4)
        for joint in _joints_between(ElementTree.parse(path).getroot(), base_link, tip_link):
            name, kind = joint.attrib["name"], joint.attrib["type"]
            T = product(T, _origin(joint))
            if kind == "fixed":
                continue
            if kind != "revolute":
                raise ValueError(
                    f"joint {name!r} between {base_link!r} and {tip_link!r} in {path} is {kind!r}"
                    " (valid: 'revolute', 'fixed')"
                )
            names.append(name)
            limits.append(_limits(joint))
            T_joint_axis = _frame_along(_vector(joint.find("axis"), "xyz", (1.0, 0.0, 0.0)))
            offsets.append(product(T, T_joint_axis))
            T = inverse(T_joint_axis)
        if not names:
            raise ValueError(f"no revolute joint between {base_link!r} and {tip_link!r} in {path}")
        lower, upper, velocity = np.array(limits).T
        return cls(tuple(names), lower, upper, velocity, np.array(offsets), T)

    def with_tool(self, T_tip_tool: Array) -> Chain:
        """Return the chain with a tool as tip; ``T_tip_tool`` (4, 4) is its pose at the old tip."""
        return dataclasses.replace(self, T_joint_tip=product(self.T_joint_tip, T_tip_tool))

    @property
    def reach(self) -> float:
        """Upper bound for the distance from the first joint's origin to the tip, metres."""
        links = [*self.T_previous_joint[1:], self.T_joint_tip]
        return total(length(T[:3, 3]) for T in links)

    def fk(self, q: ArrayLike) -> Array:
        """Return ``T_base_tip``, shape (..., 4, 4), at joint angles (..., n) in rad."""
        frames = self._joint_frames(np.asarray(q, dtype=np.float64))
        return product(frames[-1], self.T_joint_tip)

    def fk_and_jacobian(self, q: ArrayLike) -> tuple[Array, Array]:
        """Return ``T_base_tip`` (..., 4, 4) and the geometric Jacobian (..., 6, n).

        A column is the tip's velocity in base axes for 1 rad/s at that joint: linear (m/s) of
        the tip's origin, then angular (rad/s).
        """
        frames = self._joint_frames(np.asarray(q, dtype=np.float64))
        T = product(frames[-1], self.T_joint_tip)
        last = (*range(1, frames.ndim - 1), 0)  # like np.moveaxis(_, 0, -1), but ten times faster
        axes = frames[..., :3, 2].transpose(last)  # (..., 3, n)
        arms = T[..., :3, 3, None] - frames[..., :3, 3].transpose(last)
        J = np.empty((*axes.shape[:-2], 6, axes.shape[-1]))
        J[..., 3:, :] = axes
        for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
            J[..., i, :] = axes[..., j, :] * arms[..., k, :] - axes[..., k, :] * arms[..., j, :]
        return T, J

    def _joint_frames(self, q: Array) -> Array:
        """Return the joint frames, rotated by q, in the base frame, shape (n, ..., 4, 4)."""
        still, cosine, sine = self._turns
        angles = q.transpose((q.ndim - 1, *range(q.ndim - 1)))[..., None, None]
        ones = (1,) * (q.ndim - 1)
        shape = (q.shape[-1], *ones, 4, 4)
        sine_of_angle, cosine_of_angle = sincos(angles)
        frames = (
            still.reshape(shape)
            + cosine_of_angle * cosine.reshape(shape)
            + sine_of_angle * sine.reshape(shape)
        )
        reach = 1  # frame j is relative to frame j - reach
        while reach < len(frames):
            frames[reach:] = product(frames[:-reach], frames[reach:])
            reach *= 2
        return np.asarray(frames)

    @cached_property
    def _turns(self) -> tuple[Array, Array, Array]:
        """The terms (n, 4, 4) of ``T_previous_joint @ Rz(q) = still + cosine cos q + sine sin q``.

        They are precomputed: a Python loop over the joints would take most of the time.
        """
        T = self.T_previous_joint
        still, cosine, sine = T.copy(), np.zeros_like(T), np.zeros_like(T)
        still[..., :2] = 0.0
        cosine[..., :2] = T[..., :2]
        sine[..., 0], sine[..., 1] = T[..., 1], -T[..., 0]
        return still, cosine, sine


def carrier(path: str | Path, link: str, bodies: Container[str]) -> tuple[str, Array]:
    """Return the nearest body that a link of a URDF file is fixed to, and the link's pose in it.

    Args:
        path: The URDF file.
        link: Name of the link; the result may be this link itself.
        bodies: Names of the links that are bodies.

    Returns:
        The body's name and ``T_body_link`` (4, 4).
    """
    parent_joint = {
        _link(j, "child"): j for j in ElementTree.parse(path).getroot().findall("joint")
    }
    T = np.eye(4)
    while link not in bodies:
        T = product(_origin(parent_joint[link]), T)
        link = _link(parent_joint[link], "parent")
    return link, T


def _joints_between(robot: Element, base_link: str, tip_link: str) -> list[Element]:
    """Return the joints from base to tip; they are found from the tip upwards."""
    parent_joint = {_link(joint, "child"): joint for joint in robot.findall("joint")}
    joints: list[Element] = []
    link = tip_link
    while link != base_link:
        if link not in parent_joint:
            valid = ", ".join(sorted(x.attrib["name"] for x in robot.findall("link")))
            raise ValueError(f"no joints lead from {base_link!r} to {tip_link!r} (links: {valid})")
        joints.append(parent_joint[link])
        link = _link(joints[-1], "parent")
    return joints[::-1]


def _link(joint: Element, role: str) -> str:
    element = joint.find(role)
    if element is None:
        raise ValueError(f"joint {joint.attrib['name']!r} names no {role} link")
    return element.attrib["link"]


def _limits(joint: Element) -> tuple[float, float, float]:
    """Return lower (rad), upper (rad) and velocity (rad/s); the first two default to 0 in URDF."""
    limit = joint.find("limit")
    values = {} if limit is None else limit.attrib
    if "velocity" not in values:
        raise ValueError(f"revolute joint {joint.attrib['name']!r} has no <limit> with a velocity")
    lower, upper = float(values.get("lower", 0.0)), float(values.get("upper", 0.0))
    return lower, upper, float(values["velocity"])


def _vector(element: Element | None, key: str, default: tuple[float, float, float]) -> Array:
    text = None if element is None else element.get(key)
    return np.array(default if text is None else [float(x) for x in text.split()])


def _origin(joint: Element) -> Array:
    """Return a joint's pose (4, 4) in its parent link; URDF rpy is about fixed x, y, then z."""
    origin = joint.find("origin")
    return transform(
        rotation_of_rpy(_vector(origin, "rpy", (0.0, 0.0, 0.0))),
        _vector(origin, "xyz", (0.0, 0.0, 0.0)),
    )


def _frame_along(axis: Array) -> Array:
    """Return a transform (4, 4) that rotates +z to the direction of ``axis`` (3,)."""
    z = np.array([0.0, 0.0, 1.0])
    turn = np.cross(z, axis)
    sine = length(turn)
    direction = turn / sine if sine > 1e-12 else np.array([1.0, 0.0, 0.0])
    return transform(rotation_about(direction, float(arctan2(sine, axis[2]))), np.zeros(3))
