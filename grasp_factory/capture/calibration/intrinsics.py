"""Intrinsics and lens distortion of a camera from views of a ChArUco board."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from grasp_factory.capture.calibration.board import BoardSettings, BoardView, board_points
from grasp_factory.capture.calibration.kalibr import KalibrCamera
from grasp_factory.core.geometry import Array
from grasp_factory.errors import CaptureError

LEAST_CORNERS = 8
"""Corners of a view that is used."""
_LEAST_VIEWS = 5
_LEAST_TILT_SPREAD = np.radians(10.0)
"""If all views have the same tilt, focal length and distance cannot be told apart."""


@dataclass(frozen=True, slots=True, kw_only=True)
class IntrinsicsFit:
    """A pinhole camera with radial and tangential distortion."""

    K: Array
    """(3, 3) pixels."""
    distortion: Array
    """(4,) k1, k2, p1, p2."""
    size: tuple[int, int]
    """Width and height, pixels."""
    rms: float
    """Reprojection error, pixels."""
    focal_std: tuple[float, float]
    """Standard deviations of fx and fy, pixels, by the fit."""
    views: int
    corners: int
    worst_view: str
    worst_rms: float
    """Pixels."""
    coverage: float
    """Share of a grid of 8 x 6 cells of the image in which corners were seen."""

    def kalibr(self, rostopic: str = "") -> KalibrCamera:
        """Return the camera in kalibr's form."""
        return KalibrCamera(
            camera_model="pinhole",
            intrinsics=(self.K[0, 0], self.K[1, 1], self.K[0, 2], self.K[1, 2]),
            distortion_model="radtan",
            distortion_coeffs=tuple(self.distortion.tolist()),
            resolution=self.size,
            rostopic=rostopic,
        )


def calibrate_camera(views: Sequence[BoardView], settings: BoardSettings) -> IntrinsicsFit:
    """Return the intrinsics that explain the views best, by OpenCV (Zhang 2000).

    Args:
        views: of one camera; views with few corners are left out.
        settings: the board.

    Raises:
        CaptureError: for too few views, several sizes of images, or views of the same tilt.
    """
    used = [view for view in views if len(view.corners) >= LEAST_CORNERS]
    if len(used) < _LEAST_VIEWS:
        raise CaptureError(
            f"camera: the board was found in {len(used)} of {len(views)} images, valid:"
            f" {_LEAST_VIEWS} or more with {LEAST_CORNERS} corners each; check the board's settings"
        )
    sizes = {view.size for view in used}
    if len(sizes) > 1:
        raise CaptureError(f"camera: images of several sizes, {sorted(sizes)[:3]}; valid: one size")
    objects = [board_points(settings, view.numbers) for view in used]
    images = [view.corners.reshape(-1, 1, 2) for view in used]
    try:
        rms, K, distortion, turns, _, deviations, _, errors = cv2.calibrateCameraExtended(
            objects, images, used[0].size, np.eye(3), np.zeros(5), flags=cv2.CALIB_FIX_K3
        )
    except cv2.error:
        raise CaptureError("camera: the views do not determine a camera; take others") from None
    _check_tilts([np.asarray(turn, np.float64) for turn in turns])
    worst = int(np.argmax(errors))
    return IntrinsicsFit(
        K=np.asarray(K, np.float64),
        distortion=np.asarray(distortion, np.float64).ravel()[:4],
        size=used[0].size,
        rms=float(rms),
        focal_std=(float(deviations[0, 0]), float(deviations[1, 0])),
        views=len(used),
        corners=sum(len(view.corners) for view in used),
        worst_view=used[worst].name,
        worst_rms=float(np.ravel(errors)[worst]),
        coverage=_coverage(used),
    )


def _check_tilts(turns: Sequence[Array]) -> None:
    normals = np.array([cv2.Rodrigues(turn)[0][:, 2] for turn in turns])
    cosines = np.clip(normals @ normals.T, -1.0, 1.0)
    if np.arccos(cosines.min()) < _LEAST_TILT_SPREAD:
        raise CaptureError(
            "camera: all views have nearly the same tilt; valid: views that differ by 10 degrees or"
            " more, better 30"
        )


def _coverage(views: Sequence[BoardView]) -> float:
    width, height = views[0].size
    points = np.concatenate([view.corners for view in views])
    cells = np.clip((points / (width, height) * (8, 6)).astype(int), 0, (7, 5))
    return len(set(map(tuple, cells.tolist()))) / 48
