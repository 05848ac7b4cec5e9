"""The CSV files of the format ``sequences``: which columns hold which array of the store."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from numpy.typing import NDArray

from grasp_factory.core.limits import CHUNK
from grasp_factory.core.place import Place
from grasp_factory.core.schema import Field, shape
from grasp_factory.writers.exporters.csv_series import numbered, read_series

MM = 1e-3
"""Unit of depth images, m."""
_WRENCH = ("fx", "fy", "fz", "tx", "ty", "tz")
_POSE = ("px", "py", "pz", "qx", "qy", "qz", "qw")


def tables(
    joints: int, objects: int, taxels: tuple[int, int] = (0, 0)
) -> dict[str, dict[str, str]]:
    """Return by the name of a file's folder: names of columns, separated by commas, to an array.

    Args:
        joints: number of joints of the robot.
        objects: number of objects in a scene.
        taxels: rows and columns of the tactile array of real episodes.
    """
    imu = {
        "timestamp": "imu/timestamp",
        "ax,ay,az": "imu/specific_force",
        "wx,wy,wz": "imu/angular_velocity",
    }
    streams = {
        "force": {",".join(_WRENCH): "wrist_wrench"},
        "tactile": {
            ",".join(f"{side}_{name}" for side in ("left", "right") for name in _WRENCH): (
                "tactile_wrench"
            )
        },
        "robot": {
            numbered("joint_position", joints): "joint_positions",
            numbered("joint_velocity", joints): "joint_velocities",
            numbered("joint_torque", joints): "joint_torques",
            numbered("joint_position_target", joints): "joint_position_targets",
            **{name: name for name in ("gripper_width", "gripper_width_target", "gripper_force")},
            **{name: name for name in ("phase", "shake_level", "reward")},
            ",".join(f"tcp_{name}" for name in _POSE): "tcp_pose",
            "hand_fx,hand_fy,hand_fz": "hand_force",
        },
        "objects": {
            ",".join(f"object_{k}_{name}" for k in range(objects) for name in _POSE): "object_pose"
        },
    }
    rows, columns = taxels
    real = {
        "force_torque": {",".join(_WRENCH): "force_torque/wrench"},
        "joints": {
            numbered("position", joints): "joints/positions",
            numbered("velocity", joints): "joints/velocities",
            numbered("torque", joints): "joints/torques",
            numbered("position_target", joints): "joints/position_targets",
            **{
                name: f"joints/{name}"
                for name in ("gripper_width", "gripper_width_target", "gripper_force")
            },
        },
        "taxels": {
            ",".join(f"taxel_{x}_{y}" for x in range(rows) for y in range(columns)): (
                "taxels/pressure"
            )
        },
    }
    own = {name: {"timestamp": f"{name}/timestamp"} | table for name, table in real.items()}
    return (
        {"imu": imu}
        | own
        | {
            file: {"timestamp": "streams/timestamp"}
            | {columns: f"streams/{name}" for columns, name in table.items()}
            for file, table in streams.items()
        }
    )


def table_values(
    table: Mapping[str, str], contents: Mapping[str, NDArray[Any]]
) -> dict[str, NDArray[Any]]:
    """Return the values of a file by the names of their columns, each (K, columns)."""
    return {
        columns: contents[path].reshape(len(contents[path]), columns.count(",") + 1)
        for columns, path in table.items()
        if path in contents
    }


def read_table(
    place: Place, table: Mapping[str, str], fields: Mapping[str, Field], size: Mapping[str, int]
) -> dict[str, NDArray[Any]]:
    """Return the arrays of a file by path.

    Args:
        place: the file.
        table: its columns.
        fields: the store's fields by path; arrays that it does not have are not in the file.
        size: lengths of the lettered dimensions.

    Raises:
        ValueError: if the file is not as ``table_values`` wrote it.
        OSError: if it cannot be read.
        LimitError: if it is too large.
    """
    known = {columns: path for columns, path in table.items() if path in fields}
    values = read_series(place.read_bytes(CHUNK), list(known))
    return {
        path: values[columns]
        .astype(fields[path].dtype)
        .reshape(len(values[columns]), *shape(fields[path], size)[1:])
        for columns, path in known.items()
    }
