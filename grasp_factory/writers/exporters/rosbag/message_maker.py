"""Messages of ROS 1 or ROS 2 from named values; a field that is not given is zero or empty.

The definitions are those of Noetic and Humble, from rosbags: https://ternaris.gitlab.io/rosbags/
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rosbags.interfaces import Nodetype
from rosbags.typesys.store import Typestore

_KINDS = {
    **{
        f"{sign}int{bits}": f"{sign.upper()}Int{bits}" for sign in ("", "u") for bits in (8, 16, 32)
    },
    **{"int64": "Int64", "uint64": "UInt64", "float32": "Float32", "float64": "Float64"},
}
"""The name of a NumPy type in the messages of std_msgs."""


@dataclass(frozen=True, slots=True, kw_only=True)
class _Template:
    """How messages of a type are made."""

    make: Callable[..., Any]
    zeros: Mapping[str, Any]
    """The values of fields that are not given."""
    names: Mapping[str, str]
    """Fields by their names in lower case; empty if all are in lower case."""


class MessageMaker:
    """Makes messages of one version of ROS.

    A recording has tens of thousands of messages, so those that are parts of most others are made
    without names of their fields, and headers of the same instant and frame are one object.
    """

    def __init__(self, store: Typestore) -> None:
        self._store = store
        self._templates: dict[str, _Template] = {}
        self._time = store.types["builtin_interfaces/msg/Time"]
        self._vector = store.types["geometry_msgs/msg/Vector3"]
        self._point = store.types["geometry_msgs/msg/Point"]
        self._quaternion = store.types["geometry_msgs/msg/Quaternion"]
        self._pose = store.types["geometry_msgs/msg/Pose"]
        self.header = lru_cache(maxsize=64)(self._header)

    def __call__(self, kind: str, **values: Any) -> Any:
        """Return a message.

        Args:
            kind: its type, such as ``std_msgs/msg/Header``.
            values: its fields, in lower case: ROS 1 has capital letters in CameraInfo.
        """
        template = self._templates.get(kind) or self._learn(kind)
        if template.names:
            values = {template.names[name]: value for name, value in values.items()}
        return template.make(**{**template.zeros, **values})

    def _header(self, stamp_ns: int, frame: str) -> Any:
        """Return a header."""
        stamp = self._time(*divmod(stamp_ns, 10**9))
        return self("std_msgs/msg/Header", stamp=stamp, frame_id=frame)

    def vector(self, xyz: list[float]) -> Any:
        """Return a vector."""
        return self._vector(*xyz)

    def pose(self, values: list[float]) -> Any:
        """Return a pose from position (m) and quat_xyzw."""
        return self._pose(self._point(*values[:3]), self._quaternion(*values[3:]))

    def transform(self, stamp_ns: int, parent: str, child: str, pose: list[float]) -> Any:
        """Return the pose of the frame ``child`` in the frame ``parent`` as a transform."""
        return self(
            "geometry_msgs/msg/TransformStamped",
            header=self.header(stamp_ns, parent),
            child_frame_id=child,
            transform=self(
                "geometry_msgs/msg/Transform",
                translation=self.vector(pose[:3]),
                rotation=self._quaternion(*pose[3:]),
            ),
        )

    def layout(self, sizes: dict[str, int]) -> Any:
        """Return the layout of an array from the names and lengths of its dimensions."""
        lengths = list(sizes.values())
        dims = [
            self(
                "std_msgs/msg/MultiArrayDimension",
                label=label,
                size=size,
                stride=int(np.prod(lengths[k:])),
            )
            for k, (label, size) in enumerate(sizes.items())
        ]
        return self("std_msgs/msg/MultiArrayLayout", dim=dims)

    def _learn(self, kind: str) -> _Template:
        """Note class, zeros and names of a type's fields."""
        _, fields = self._store.fielddefs[kind]
        names = {name.lower(): name for name, _ in fields}
        template = self._templates[kind] = _Template(
            make=self._store.types[kind],
            zeros={name: self._zero(of) for name, of in fields},
            names=names if any(name != lower for lower, name in names.items()) else {},
        )
        return template

    def _zero(self, of: Any) -> Any:
        node, detail = of
        if node is Nodetype.NAME:
            return self(detail)
        if node is Nodetype.BASE:
            return "" if detail[0] == "string" else np.zeros((), _dtype(detail[0])).item()
        (inner, name), count = detail
        if inner is Nodetype.BASE and name[0] != "string":
            return np.zeros(count, _dtype(name[0]))
        return []


def number_kind(values: NDArray[Any], *, is_array: bool) -> str:
    """Return the type of std_msgs that holds one number, or an array, of a NumPy type."""
    return f"std_msgs/msg/{_KINDS[values.dtype.name]}{'MultiArray' if is_array else ''}"


def _dtype(name: str) -> np.dtype[Any]:
    return np.dtype({"byte": "uint8", "char": "uint8", "octet": "uint8"}.get(name, name))
