"""The intrinsics of a camera from a calibration file, for its camera_info messages."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from grasp_factory.core.config.yaml_loader import parse_yaml
from grasp_factory.errors import CaptureError, shown

MOST_BYTES = 1_000_000
MODELS: Mapping[str, tuple[str, int]] = {
    "radtan": ("plumb_bob", 5),
    "equidistant": ("equidistant", 4),
    "none": ("plumb_bob", 5),
}
"""kalibr's words to those of ROS, and how many coefficients ROS has (missing ones are 0).

https://github.com/ethz-asl/kalibr/wiki/supported-models, https://www.ros.org/reps/rep-0150.html
"""


@dataclass(frozen=True, slots=True, kw_only=True)
class CameraIntrinsics:
    """A pinhole camera with distortion, in pixels."""

    width: int
    height: int
    fx: float
    fy: float
    cx: float
    cy: float
    model: str
    """ROS's name of the distortion."""
    distortion: tuple[float, ...]


def read_calibration(path: Path) -> bytes:
    """Return the content of a calibration file.

    Raises:
        CaptureError: if it cannot be read, or is too large.
    """
    try:
        with path.open("rb") as file:
            content = file.read(MOST_BYTES + 1)
    except OSError as error:
        raise CaptureError(f"{path} cannot be read: {error.strerror}") from None
    if len(content) > MOST_BYTES:
        raise CaptureError(f"{path} is no calibration: it has more than {MOST_BYTES} bytes")
    return content


def camera_intrinsics(content: bytes, path: Path) -> CameraIntrinsics:
    """Return the intrinsics in a file: kalibr's camchain (cam0), or width, height, K and D.

    Raises:
        CaptureError: if it has none, or numbers that are none of a camera.
    """
    try:
        data = parse_yaml(content.decode("utf-8"), f"calibration {path}")
    except ValueError as error:
        raise CaptureError(str(error)) from None
    try:
        return _of_camchain(data["cam0"]) if "cam0" in data else _of_matrix(data)
    except (KeyError, TypeError, ValueError, IndexError, OverflowError) as error:
        raise CaptureError(
            f"{path} is no calibration of a camera ({type(error).__name__}: {error}); valid:"
            " kalibr's camchain with cam0, or width, height, K and D"
        ) from None


def _of_camchain(data: Mapping[str, Any]) -> CameraIntrinsics:
    if data["camera_model"] != "pinhole":
        raise ValueError(f"camera_model {shown(data['camera_model'])}, valid: pinhole")
    model, count = MODELS[data["distortion_model"]]
    fx, fy, cx, cy = map(float, data["intrinsics"])
    width, height = data["resolution"]
    distortion = [float(x) for x in data["distortion_coeffs"]]
    return _checked((width, height), (fx, fy, cx, cy), model, distortion, count)


def _of_matrix(data: Mapping[str, Any]) -> CameraIntrinsics:
    flat = [float(x) for row in data["K"] for x in (row if isinstance(row, list) else [row])]
    if len(flat) != 9:
        raise ValueError(f"K has {len(flat)} numbers, valid: 9")
    pinhole = (flat[0], flat[4], flat[2], flat[5])
    distortion = [float(x) for x in data.get("D", [])]
    return _checked((data["width"], data["height"]), pinhole, "plumb_bob", distortion, 5)


def _checked(
    size: tuple[Any, Any], pinhole: Sequence[float], model: str, distortion: list[float], count: int
) -> CameraIntrinsics:
    width, height = size
    if not (0 < int(width) <= 65_536 and 0 < int(height) <= 65_536):
        raise ValueError(f"size {width} x {height}, valid: 1 to 65536")
    if not all(map(math.isfinite, (*pinhole, *distortion))) or min(pinhole[:2]) <= 0.0:
        raise ValueError("numbers that are not finite, or no focal length")
    if len(distortion) > count:
        raise ValueError(f"{len(distortion)} coefficients of distortion, valid: up to {count}")
    fx, fy, cx, cy = pinhole
    return CameraIntrinsics(
        width=int(width),
        height=int(height),
        fx=fx,
        fy=fy,
        cx=cx,
        cy=cy,
        model=model,
        distortion=(*distortion, *[0.0] * (count - len(distortion))),
    )
