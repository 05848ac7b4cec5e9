"""The calibration of a force-torque sensor: its file, and how it is made."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from grasp_factory.capture.calibration.csv_columns import read_columns
from grasp_factory.capture.calibration.document import read_document, record_of, write_document
from grasp_factory.capture.calibration.load_identification import (
    LoadedPose,
    LoadFit,
    identify_load,
)
from grasp_factory.capture.calibration.series_source import read_series
from grasp_factory.capture.calibration.tare import TareRule, tare_zero
from grasp_factory.core.executors.base import SendMessage
from grasp_factory.core.executors.import_process import in_import_process
from grasp_factory.core.geometry import Array
from grasp_factory.core.serialization import check, from_plain, normalise, to_plain
from grasp_factory.core.vectors import Vector3
from grasp_factory.errors import CaptureError
from grasp_factory.signals.noise.wrench import Six
from grasp_factory.signals.wrench import calibrate

Matrix6 = tuple[Six, Six, Six, Six, Six, Six]
_IDENTITY: Matrix6 = tuple(tuple(row) for row in np.eye(6).tolist())  # type: ignore[assignment]
_QUAT, _COM = ("qx", "qy", "qz", "qw"), ("load_x", "load_y", "load_z")
_RAW = ("c0", "c1", "c2", "c3", "c4", "c5")
_MOST_POSES = 10_000


@dataclass(frozen=True, slots=True, kw_only=True)
class FtCalibration:
    """Matrix, zero and tool of a force-torque sensor: wrench = matrix @ (raw - zero)."""

    matrix: Matrix6 = _IDENTITY
    """N and N m per unit of the raw channels."""
    zero: Six = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    """Raw channels without load."""
    tool_mass: float = 0.0
    """kg beyond the sensor that ``zero`` does not include."""
    tool_com: Vector3 = (0.0, 0.0, 0.0)
    """Centre of mass of the tool in the sensor's frame, m."""
    frame: str = "sensor"
    """Name of the frame in which the wrenches are."""

    def __post_init__(self) -> None:
        """Check the values.

        Raises:
            ConfigError: naming the key.
        """
        normalise(self)
        singular = np.linalg.cond(np.array(self.matrix)) > 1e12
        check(not singular, "matrix", self.matrix, "6 x 6 numbers with an inverse")
        check(0.0 <= self.tool_mass <= 1000.0, "tool_mass", self.tool_mass, "0 to 1000 kg")
        check(0 < len(self.frame) <= 200, "frame", self.frame, "a name of 1 to 200 characters")

    def wrench(self, raw: Array) -> Array:
        """Return wrenches (N, 6) of raw channels (N, 6): ``matrix @ (raw - zero)``."""
        return calibrate(raw, self.matrix, self.zero)


def read_ft(path: Path) -> FtCalibration:
    """Return the calibration in a file.

    Raises:
        UsageError: if the file cannot be opened.
        CaptureError: if it is no such file.
    """
    return record_of(FtCalibration, read_document(path), path)


def write_ft(path: Path, calibration: FtCalibration) -> None:
    """Write a new file.

    Raises:
        UsageError: if the name is taken, or its folder does not exist.
        StoreError: if it cannot be written.
    """
    write_document(path, to_plain(calibration))


def tared(
    source: Path, before: FtCalibration | None, rule: TareRule, topic: str = ""
) -> FtCalibration:
    """Return a calibration with a new zero, from a recording of raw channels without load.

    Args:
        source: the recording; see ``read_series``.
        before: the calibration until now: its matrix stays, and its zero shows a load.
        rule: what counts as rest.
        topic: of a session or bag.

    Raises:
        UsageError: if the recording cannot be opened.
        CaptureError: if it is damaged, too short, in motion, or under load.
    """
    raw = read_series(source, "wrench", topic).values
    base = before or FtCalibration()
    zero = tare_zero(raw, base.matrix, rule, None if before is None else before.zero)
    return FtCalibration(**{**_fields(base), "zero": tuple(zero.tolist())})


def identified(poses: Path, before: FtCalibration | None) -> tuple[FtCalibration, LoadFit]:
    """Return a calibration from poses with known loads, and the fit.

    Args:
        poses: a CSV file with a row for each pose; see ``read_poses``.
        before: a calibration whose matrix is used; None to find the matrix too.

    Raises:
        UsageError: if the file cannot be opened.
        CaptureError: if it is damaged, or leaves a value open.
    """
    found = identify_load(read_poses(poses), None if before is None else before.matrix)
    com = np.nan_to_num(found.tool_com, nan=0.0)
    plain = {
        "matrix": found.matrix.tolist(),
        "zero": found.zero.tolist(),
        "tool_mass": max(found.tool_mass, 0.0),
        "tool_com": com.tolist(),
        "frame": (before or FtCalibration()).frame,
    }
    return from_plain(FtCalibration, plain), found


def read_poses(path: Path) -> list[LoadedPose]:
    """Return the poses of a CSV file: columns qx qy qz qw, c0 to c5, load_mass, load_x, y, z.

    The quaternion is R_world_sensor, c0 to c5 are mean raw channels at rest, the load's mass is in
    kg and its centre in metres in the sensor's frame. The columns of the load may be left out.

    Raises:
        UsageError: if the file cannot be opened.
        CaptureError: if it is no such file.
    """
    columns: dict[str, Array] = in_import_process(_pose_columns, path, path)
    count = len(columns["qw"])
    for name in ("load_mass", *_COM):
        columns[name] = np.nan_to_num(columns.get(name, np.zeros(count)))
    table = {name: values.tolist() for name, values in columns.items()}
    if not all(np.isfinite(values).all() for values in columns.values()):
        raise CaptureError(f"{path}: cells are empty or not finite; valid: numbers")
    if not 1 <= count <= _MOST_POSES:
        raise CaptureError(f"{path}: got {count} poses, valid: 1 to {_MOST_POSES}")
    quats = np.column_stack([columns[name] for name in _QUAT])
    if (np.abs(np.linalg.norm(quats, axis=1) - 1.0) > 0.01).any():
        raise CaptureError(f"{path}: qx, qy, qz, qw: valid: quaternions of length 1")
    return [
        LoadedPose(
            quat_xyzw=tuple(table[name][k] for name in _QUAT),
            raw=tuple(table[name][k] for name in _RAW),
            load_mass=table["load_mass"][k],
            load_com=tuple(table[name][k] for name in _COM),
        )
        for k in range(count)
    ]


def _pose_columns(path: Path, report: SendMessage) -> dict[str, Array]:
    return read_columns(path, (*_QUAT, *_RAW), ("load_mass", *_COM))


def _fields(calibration: FtCalibration) -> dict[str, Any]:
    return {name: getattr(calibration, name) for name in calibration.__slots__}
