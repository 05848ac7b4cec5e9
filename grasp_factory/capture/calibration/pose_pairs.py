"""Pairs of poses for hand-eye calibration: from JSON or CSV, or from images and poses.

JSON: a list of ``{"T_base_gripper": 4 x 4, "T_camera_target": 4 x 4}``. CSV: a row for each pair
with position (m) and quaternion of both, ``gripper_x, y, z, qx, qy, qz, qw`` and ``target_...``.
With images, the CSV file has ``gripper_...`` only, a row for each image in the order of names.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from grasp_factory.capture.calibration.board import BoardSettings, board_pose
from grasp_factory.capture.calibration.board_images import board_views
from grasp_factory.capture.calibration.csv_columns import read_columns
from grasp_factory.capture.calibration.document import read_bytes, record_of
from grasp_factory.capture.calibration.hand_eye import PosePair
from grasp_factory.capture.calibration.kalibr import KalibrCamera, Matrix4
from grasp_factory.core.executors.base import SendMessage
from grasp_factory.core.executors.import_process import in_import_process
from grasp_factory.core.geometry import Array, quat_xyzw_to_matrix, transform
from grasp_factory.core.json_text import parsed
from grasp_factory.errors import CaptureError, UsageError

_PARTS = ("x", "y", "z", "qx", "qy", "qz", "qw")
_MOST_PAIRS = 2000


@dataclass(frozen=True, slots=True, kw_only=True)
class StoredPair:
    """A pair in a JSON file."""

    T_base_gripper: Matrix4
    T_camera_target: Matrix4


def read_pairs(path: Path) -> list[PosePair]:
    """Return the pairs in a JSON or CSV file.

    Raises:
        UsageError: if the file cannot be opened, or has another suffix.
        CaptureError: if it is no such file.
    """
    if path.suffix == ".json":
        return _of_json(path)
    if path.suffix != ".csv":
        raise UsageError(f"{path}: valid: a .json or a .csv file with pairs of poses")
    hands, targets = _poses(path, "gripper"), _poses(path, "target")
    return [
        PosePair(T_base_gripper=hand, T_camera_target=target)
        for hand, target in zip(hands, targets, strict=True)
    ]


def pairs_of_images(
    images: Path,
    poses: Path,
    camera: KalibrCamera,
    board: BoardSettings,
    on_image: Callable[[], None] = lambda: None,
) -> list[PosePair]:
    """Return the pairs of images of a board and of the gripper's poses.

    The rows of ``poses`` belong to the images in the order of their names. Images without the board
    are left out.

    Args:
        images: a folder.
        poses: a CSV file with the columns ``gripper_...``.
        camera: its intrinsics.
        board: the board.
        on_image: called after each image.

    Raises:
        UsageError: if a file cannot be opened.
        CaptureError: if a file is damaged, the numbers differ, or the camera is no pinhole.
    """
    if (camera.camera_model, camera.distortion_model) not in (
        ("pinhole", "radtan"),
        ("pinhole", "none"),
    ):
        got = f"{camera.camera_model} with {camera.distortion_model}"
        raise CaptureError(f"hand-eye: camera {got}, valid: pinhole with radtan or none")
    fx, fy, cx, cy = camera.intrinsics
    K = np.array([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]])
    distortion = np.array(camera.distortion_coeffs or (0.0,) * 4)
    hands = _poses(poses, "gripper")
    views = board_views(images, board, most=_MOST_PAIRS, on_image=on_image)
    if len(views) != len(hands):
        raise CaptureError(
            f"{poses}: got {len(hands)} poses for {len(views)} images, valid: a row for each image"
        )
    pairs = []
    for hand, view in zip(hands, views, strict=True):
        target = board_pose(view, board, K, distortion)
        if target is not None:
            pairs.append(PosePair(T_base_gripper=hand, T_camera_target=target))
    return pairs


def _of_json(path: Path) -> list[PosePair]:
    try:
        data = parsed(read_bytes(path))
    except ValueError as error:
        raise CaptureError(f"{path} is no JSON: {error}") from None
    if not isinstance(data, list) or not 1 <= len(data) <= _MOST_PAIRS:
        raise CaptureError(f"{path}: valid: a list of 1 to {_MOST_PAIRS} pairs of poses")
    pairs = []
    for k, item in enumerate(data):
        stored = record_of(StoredPair, item, path, f"[{k}]")
        both = [np.array(stored.T_base_gripper), np.array(stored.T_camera_target)]
        for T in both:
            _check_pose(path, k, T)
        pairs.append(PosePair(T_base_gripper=both[0], T_camera_target=both[1]))
    return pairs


def _check_pose(path: Path, k: int, T: Array) -> None:
    is_turn = np.abs(T[:3, :3] @ T[:3, :3].T - np.eye(3)).max() < 1e-3
    if not (is_turn and np.linalg.det(T) > 0.0 and np.array_equal(T[3], (0.0, 0.0, 0.0, 1.0))):
        raise CaptureError(
            f"{path}: pair {k} has a matrix that is no rotation and translation (4 x 4)"
        )


def _poses(path: Path, name: str) -> list[Array]:
    columns: dict[str, Array] = in_import_process(_pose_columns, (path, name), path)
    rows = np.column_stack([columns[f"{name}_{part}"] for part in _PARTS])
    if not 1 <= len(rows) <= _MOST_PAIRS:
        raise CaptureError(f"{path}: got {len(rows)} rows, valid: 1 to {_MOST_PAIRS}")
    lengths = np.linalg.norm(rows[:, 3:], axis=1)
    if not (np.isfinite(rows).all() and (np.abs(lengths - 1.0) < 0.01).all()):
        raise CaptureError(f"{path}: {name}_...: valid: finite numbers, quaternions of length 1")
    return [transform(quat_xyzw_to_matrix(row[3:]), row[:3]) for row in rows]


def _pose_columns(job: tuple[Path, str], report: SendMessage) -> Any:
    path, name = job
    return read_columns(path, tuple(f"{name}_{part}" for part in _PARTS))
