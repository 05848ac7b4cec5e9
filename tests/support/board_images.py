"""Images of a ChArUco board by exact projection through a camera with distortion."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from grasp_factory.capture.calibration.board import BoardSettings

Array = NDArray[np.float64]
BOARD = BoardSettings()
K = np.array([[605.0, 0.0, 322.0], [0.0, 604.0, 241.0], [0.0, 0.0, 1.0]])
DISTORTION = np.array([0.05, -0.1, 0.001, -0.0005])
SIZE = 640, 480
_SQUARE_PIXELS = 100
BLUR, NOISE = 0.7, 3.0
"""Standard deviations: of the lens, pixels, and of the sensor, grey levels."""


@dataclass(frozen=True, slots=True)
class BoardRenderer:
    """Renders the board as the camera sees it."""

    texture: NDArray[np.uint8]
    rays: Array
    """(W * H, 3) directions of the pixels."""

    @classmethod
    def make(cls) -> BoardRenderer:
        width, height = SIZE
        u, v = np.meshgrid(np.arange(width, dtype=np.float64), np.arange(height, dtype=np.float64))
        pixels = np.stack([u, v], -1).reshape(-1, 1, 2)
        points = cv2.undistortPoints(pixels, K, DISTORTION).reshape(-1, 2)
        sides = BOARD.columns * _SQUARE_PIXELS, BOARD.rows * _SQUARE_PIXELS
        texture = BOARD.board().generateImage(sides, marginSize=0)
        return cls(np.asarray(texture, np.uint8), np.column_stack([points, np.ones(len(points))]))

    def image(self, T_camera_board: Array, rng: np.random.Generator) -> NDArray[np.uint8]:
        """Return the grey image: each pixel's ray is cut with the board's plane."""
        R, position = T_camera_board[:3, :3], T_camera_board[:3, 3]
        normal = R[:, 2]
        distance = (normal @ position) / (self.rays @ normal)
        on_board = (self.rays * distance[:, None] - position) @ R
        at = (on_board[:, :2] / BOARD.square_m * _SQUARE_PIXELS - 0.5).astype(np.float32)
        width, height = SIZE
        x, y = (at[:, k].reshape(height, width) for k in range(2))
        sharp = cv2.remap(self.texture, x, y, cv2.INTER_LINEAR, borderValue=(200,))
        seen = cv2.GaussianBlur(sharp, (0, 0), BLUR) + rng.normal(0.0, NOISE, (height, width))
        return np.clip(np.round(seen), 0, 255).astype(np.uint8)


def board_poses(count: int, rng: np.random.Generator) -> list[Array]:
    """Return ``T_camera_board`` (4, 4) in front of the camera, tilted by up to 35 degrees."""
    middle = np.array([BOARD.columns, BOARD.rows, 0.0]) * BOARD.square_m / 2.0
    found = []
    for _ in range(count):
        T = np.eye(4)
        angles = rng.uniform((-0.6, -0.6, -0.4), (0.6, 0.6, 0.4))
        T[:3, :3] = Rotation.from_euler("xyz", angles).as_matrix()
        center = rng.uniform((-0.05, -0.04, 0.33), (0.05, 0.04, 0.5))
        T[:3, 3] = center - T[:3, :3] @ middle
        found.append(T)
    return found


def random_pose(rng: np.random.Generator, reach: float) -> Array:
    T = np.eye(4)
    T[:3, :3] = Rotation.random(rng=rng).as_matrix()
    T[:3, 3] = rng.uniform(-reach, reach, 3)
    return T
