"""The ChArUco board: its settings, its corners in an image, its pose."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from grasp_factory.core.geometry import Array
from grasp_factory.core.serialization import check, check_range, normalise

_FAMILIES = ("4x4", "5x5", "6x6", "7x7")
_COUNTS = (50, 100, 250, 1000)
DICTIONARIES = tuple(f"{family}_{count}" for family in _FAMILIES for count in _COUNTS)
"""Names of ArUco dictionaries: bits of a marker, and number of markers."""


@dataclass(frozen=True, slots=True, kw_only=True)
class BoardSettings:
    """A ChArUco board: a chessboard with ArUco markers in its white squares."""

    columns: int = 7
    """Squares in a row."""
    rows: int = 5
    square_m: float = 0.04
    """Side of a square, metres: measure it on the print."""
    marker_m: float = 0.03
    """Side of a marker, metres."""
    dictionary: str = "4x4_50"
    """A name of ``DICTIONARIES``."""
    legacy: bool = False
    """Whether the board has the pattern of OpenCV before 4.6, for an even number of rows."""

    def __post_init__(self) -> None:
        """Check the values.

        Raises:
            ConfigError: naming the setting.
        """
        normalise(self)
        check_range(self, "columns", 3, 60)
        check_range(self, "rows", 3, 60)
        check_range(self, "square_m", 1e-4, 10.0, "m")
        below = 0.0 < self.marker_m < self.square_m
        check(below, "marker_m", self.marker_m, f"above 0 and below the square, {self.square_m} m")
        check(self.dictionary in DICTIONARIES, "dictionary", self.dictionary,
              ", ".join(DICTIONARIES))  # fmt: skip
        markers, most = self.columns * self.rows // 2, int(self.dictionary.partition("_")[2])
        fits = f"a dictionary of {markers} markers or more"
        check(markers <= most, "dictionary", self.dictionary, fits)

    def board(self) -> cv2.aruco.CharucoBoard:
        """Return OpenCV's board."""
        number = getattr(cv2.aruco, f"DICT_{self.dictionary.upper()}")
        board = cv2.aruco.CharucoBoard(
            (self.columns, self.rows),
            self.square_m,
            self.marker_m,
            cv2.aruco.getPredefinedDictionary(number),
        )
        board.setLegacyPattern(self.legacy)
        return board


@dataclass(frozen=True, slots=True, kw_only=True)
class BoardView:
    """The corners of a board that an image shows."""

    name: str
    """Of the image."""
    size: tuple[int, int]
    """Width and height of the image, pixels."""
    corners: NDArray[np.float32]
    """(C, 2) pixels, of the inner corners of the chessboard."""
    numbers: NDArray[np.int32]
    """(C,) which corner each is."""


def find_board(image: NDArray[np.uint8], name: str, settings: BoardSettings) -> BoardView:
    """Return the corners of the board in an image, possibly none.

    Args:
        image: (H, W) grey or (H, W, 3).
        name: for messages.
        settings: the board.
    """
    detector = cv2.aruco.CharucoDetector(settings.board())
    corners, numbers, _, _ = detector.detectBoard(image)
    has_some = corners is not None and numbers is not None and len(corners) > 0
    found = np.reshape(corners, (-1, 2)) if has_some else np.empty((0, 2))
    height, width = image.shape[:2]
    return BoardView(
        name=name,
        size=(width, height),
        corners=found.astype(np.float32),
        numbers=np.reshape(numbers if has_some else [], -1).astype(np.int32),
    )


def board_points(settings: BoardSettings, numbers: NDArray[np.int32]) -> NDArray[np.float32]:
    """Return the corners with these numbers in the board's frame, (C, 3) m."""
    points: NDArray[np.float32] = np.asarray(settings.board().getChessboardCorners(), np.float32)
    return points[numbers]


def board_pose(
    view: BoardView, settings: BoardSettings, K: Array, distortion: Array
) -> Array | None:
    """Return ``T_camera_board`` (4, 4), or None if the view has too few corners.

    Args:
        view: the corners.
        settings: the board.
        K: (3, 3) pixels.
        distortion: (4,) or (5,), as in OpenCV.
    """
    if len(view.corners) < 6:
        return None
    points = board_points(settings, view.numbers)
    is_found, turn, position = cv2.solvePnP(points, view.corners, K, distortion)
    if not is_found:
        return None
    T = np.eye(4)
    T[:3, :3] = cv2.Rodrigues(turn)[0]
    T[:3, 3] = position.ravel()
    return T
