"""Calibration files in kalibr's form: the noise of an IMU, and a chain of cameras.

The forms are those of kalibr's wiki, pages "yaml formats" and "IMU Noise Model". The noise of an
IMU stands at the top of the file (kalibr's input), or under ``imu0`` (its output).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from grasp_factory.capture.calibration.document import read_document, record_of, write_document
from grasp_factory.core.serialization import check, check_range, normalise, to_plain
from grasp_factory.errors import CaptureError, shown

Row4 = tuple[float, float, float, float]
Matrix4 = tuple[Row4, Row4, Row4, Row4]
INTRINSICS: Mapping[str, int] = {"pinhole": 4, "omni": 5, "ds": 6, "eucm": 6}
"""Camera models, and how many intrinsics each has."""
DISTORTION: Mapping[str, int] = {"radtan": 4, "equidistant": 4, "fov": 1, "none": 0}
"""Distortion models, and how many coefficients each has."""
_MOST_CAMERAS = 32
_RIGID = 1e-3
"""Deviation from a rotation that a file with rounded numbers may have."""


@dataclass(frozen=True, slots=True, kw_only=True)
class KalibrImu:
    """Noise of an inertial sensor, as in kalibr's imu.yaml."""

    accelerometer_noise_density: float
    """m/s2/sqrt(Hz)."""
    accelerometer_random_walk: float
    """m/s3/sqrt(Hz)."""
    gyroscope_noise_density: float
    """rad/s/sqrt(Hz)."""
    gyroscope_random_walk: float
    """rad/s2/sqrt(Hz)."""
    update_rate: float
    """Hz."""
    rostopic: str = ""
    model: str | None = None
    """Such as ``calibrated`` or ``scale-misalignment``."""
    time_offset: float | None = None
    """Seconds."""
    T_i_b: Matrix4 | None = None
    """Maps the body's frame, that of the first IMU, to this IMU's."""

    def __post_init__(self) -> None:
        """Check the values.

        Raises:
            ConfigError: naming the key.
        """
        normalise(self)
        for sensor in ("accelerometer", "gyroscope"):
            check_range(self, f"{sensor}_noise_density", 0.0, 1e3)
            check_range(self, f"{sensor}_random_walk", 0.0, 1e3)
        check_range(self, "update_rate", 1e-3, 1e6, "Hz")
        _check_rigid("T_i_b", self.T_i_b)


@dataclass(frozen=True, slots=True, kw_only=True)
class KalibrCamera:
    """A camera of a chain, as in kalibr's camchain.yaml."""

    camera_model: str
    """A name of ``INTRINSICS``."""
    intrinsics: tuple[float, ...]
    """Of a pinhole camera fx, fy, cx, cy, pixels."""
    distortion_model: str
    """A name of ``DISTORTION``."""
    distortion_coeffs: tuple[float, ...]
    """Of radtan k1, k2, p1, p2, as in OpenCV."""
    resolution: tuple[int, int]
    """Width and height, pixels."""
    rostopic: str = ""
    cam_overlaps: tuple[int, ...] = ()
    """Numbers of cameras that see the same."""
    T_cn_cnm1: Matrix4 | None = None
    """Maps the frame of the camera before this one in the chain to this one's."""
    T_cam_imu: Matrix4 | None = None
    """Maps the IMU's frame to the camera's."""
    timeshift_cam_imu: float | None = None
    """Seconds: ``t_imu = t_cam + timeshift``."""

    def __post_init__(self) -> None:
        """Check the values.

        Raises:
            ConfigError: naming the key.
        """
        normalise(self)
        for key, table, values in (
            ("camera_model", INTRINSICS, self.intrinsics),
            ("distortion_model", DISTORTION, self.distortion_coeffs),
        ):
            name = getattr(self, key)
            check(name in table, key, name, ", ".join(table))
            count = f"{table[name]} numbers for {name}"
            list_key = "intrinsics" if table is INTRINSICS else "distortion_coeffs"
            check(len(values) == table[name], list_key, values, count)
        check(all(1 <= n <= 65536 for n in self.resolution), "resolution", self.resolution,
              "two sides of 1 to 65536 pixels")  # fmt: skip
        _check_rigid("T_cn_cnm1", self.T_cn_cnm1)
        _check_rigid("T_cam_imu", self.T_cam_imu)


def read_imu(path: Path) -> KalibrImu:
    """Return the noise in a kalibr imu.yaml.

    Raises:
        UsageError: if the file cannot be opened.
        CaptureError: if it is no such file.
    """
    data = read_document(path)
    nested = data.get("imu0")
    if nested is not None and len(data) > 1:
        raise CaptureError(f"{path}: got {len(data)} keys beside imu0, valid: one IMU, imu0")
    return record_of(KalibrImu, data if nested is None else nested, path)


def write_imu(path: Path, imu: KalibrImu) -> None:
    """Write a kalibr imu.yaml.

    Raises:
        UsageError: if the name is taken, or its folder does not exist.
        StoreError: if it cannot be written.
    """
    write_document(path, _given(imu))


def read_camchain(path: Path) -> tuple[KalibrCamera, ...]:
    """Return the cameras of a kalibr camchain.yaml: cam0, cam1, and so on.

    Raises:
        UsageError: if the file cannot be opened.
        CaptureError: if it is no such file.
    """
    data = read_document(path)
    names = [f"cam{k}" for k in range(len(data))]
    if not 1 <= len(data) <= _MOST_CAMERAS or set(data) != set(names):
        raise CaptureError(
            f"{path}: got the keys {shown(list(data))}, valid: cam0, cam1, ..., up to"
            f" {_MOST_CAMERAS} cameras"
        )
    return tuple(record_of(KalibrCamera, data[name], path, name) for name in names)


def write_camchain(path: Path, cameras: Sequence[KalibrCamera]) -> None:
    """Write a kalibr camchain.yaml.

    Raises:
        UsageError: if the name is taken, or its folder does not exist.
        StoreError: if it cannot be written.
    """
    write_document(path, {f"cam{k}": _given(camera) for k, camera in enumerate(cameras)})


def _given(record: Any) -> dict[str, Any]:
    return {key: value for key, value in to_plain(record).items() if value is not None}


def _check_rigid(key: str, matrix: Matrix4 | None) -> None:
    if matrix is None:
        return
    T = np.array(matrix)
    R = T[:3, :3]
    is_rotation = np.abs(R @ R.T - np.eye(3)).max() < _RIGID and np.linalg.det(R) > 0.0
    is_rigid = is_rotation and np.array_equal(T[3], (0.0, 0.0, 0.0, 1.0))
    check(bool(is_rigid), key, matrix, "a rotation and a translation, last row 0, 0, 0, 1")
