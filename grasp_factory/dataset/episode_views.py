"""Sensor data of a store's episodes, read on demand: images, series, point clouds, crops."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from grasp_factory.core.config.factory_config import FactoryConfig
from grasp_factory.core.episode import CameraImage, EpisodeSpec
from grasp_factory.core.geometry import Array
from grasp_factory.dataset.checked_reader import CheckedColumns
from grasp_factory.dataset.episode_choice import EpisodeChoice
from grasp_factory.dataset.features import Features
from grasp_factory.dataset.joined_stores import JoinedColumns
from grasp_factory.dataset.row_lookup import RowIndex
from grasp_factory.dataset.sensor_reader import IMAGES, Readings
from grasp_factory.errors import UsageError, shown
from grasp_factory.signals.grasp_crop import CropShape, GraspCrop
from grasp_factory.signals.point_cloud import PointCloud
from grasp_factory.writers.zarr.columns import Columns

RIGID = 1e-4
"""Tolerance of R @ R.T to the identity for a rotation R, which may be rounded to float32."""


class EpisodeViews(EpisodeChoice):
    """The table of a dataset, and the sensor data of its rows.

    Attributes:
        config: the configuration that the store was made from.
    """

    config: FactoryConfig

    def __init__(
        self,
        columns: Columns | CheckedColumns | JoinedColumns,
        features: Features,
        rows: RowIndex,
        readings: Readings,
    ) -> None:
        """Use a store's columns, its features, the index of the rows, and its readings."""
        super().__init__(columns, features, rows)
        self._readings = readings

    def spec(self, index: int) -> EpisodeSpec:
        """Return the recipe of an episode, also of a quarantined one.

        Raises:
            IndexError: naming the valid range.
            StoreError: if the row is missing or damaged.
        """
        return self._readings.spec(self._rows.present(index)[0])

    def specs(self, indices: Iterable[int]) -> Iterator[EpisodeSpec]:
        """Iterate over the recipes of episodes, in the order of their indices.

        Raises:
            TypeError, IndexError, StoreError: as for ``dataset[indices]``.
        """
        return self._readings.specs(self._rows.several(indices).tolist())

    def image(self, index: int, camera: str, kind: str, frame: int) -> NDArray[Any]:
        """Return one image; no other image is read.

        Args:
            index: the index of the episode.
            camera: a key of ``config.cameras``.
            kind: rgb (H, W, 3) uint8, depth (H, W) float32 in metres, or segmentation (H, W) uint8.
            frame: 0 before the attempt, 1 after.

        Raises:
            UnknownNameError: for a camera or kind that the store does not have.
            IndexError: for an episode or a frame out of range.
            StoreError: if the row is missing, quarantined or damaged.
        """
        image: NDArray[Any] = self.images([index], camera, kind, frame)[0]
        return image

    def images(
        self, indices: slice | Iterable[int], camera: str, kind: str, frame: int
    ) -> NDArray[Any]:
        """Return the image of each of K episodes, (K, H, W, ...); each shard is opened once.

        Args:
            indices: the indices of the episodes, in any order, or a slice; the images have the
                same order.
            camera: see ``image``.
            kind: see ``image``.
            frame: see ``image``.

        Raises:
            UnknownNameError, IndexError, StoreError: as ``image`` does.
        """
        self._readings.check_image(camera, kind, frame)  # reported before a wrong index
        rows = self._rows.several(indices).tolist()
        return self._readings.images(rows, camera, kind, frame)

    def point_cloud(
        self,
        index: int,
        camera: str | None = None,
        frame: int = 0,
        *,
        of: str = "scene",
        in_frame: str = "world",
    ) -> PointCloud:
        """Return what cameras see of an episode's scene as coloured, labelled points.

        Pixels without depth, and pixels that see nothing before the far plane, yield no point.

        Args:
            index: the index of the episode.
            camera: a key of ``config.cameras``; None for all of them in one cloud.
            frame: 0 before the attempt, 1 after.
            of: scene, objects (the target and the others), or one label's name, such as target.
            in_frame: world, camera, tcp, grasp or object; see ``point_cloud.FRAMES``.

        Raises:
            UnknownNameError: for an unknown name.
            UsageError: if ``in_frame`` is camera and several cameras are used, or if the episode
                lacks the grasp or the attempt that the frame needs.
            IndexError, StoreError: as ``image`` does.
        """
        for name in self.config.cameras if camera is None else (camera,):
            self._readings.check_image(name, "depth", frame)
        row = self._rows.committed(index)
        return self._readings.cloud(row, camera, frame, of, in_frame)

    def calibration(self, index: int, camera: str, frame: int) -> tuple[Array, Array]:
        """Return a camera's intrinsics K (3, 3), pixels, and pose ``T_world_camera`` (4, 4).

        Raises:
            UnknownNameError, IndexError, StoreError: as ``image`` does.
        """
        self._readings.check_image(camera, "depth", frame)
        row = self._rows.committed(index)
        intrinsics, poses = self._readings.calibrations([row], camera, frame)
        return intrinsics[0], poses[0]

    def scenes(
        self, indices: slice | Iterable[int], kinds: Sequence[str] = IMAGES, frame: int = 0
    ) -> list[dict[str, CameraImage]]:
        """Return what each camera sees in each of K episodes; each shard is opened once.

        Args:
            indices: the indices of the episodes, in any order, or a slice; the scenes have the
                same order.
            kinds: the kinds of images to read; other images are all 0, and need no time or memory.
            frame: 0 before the attempt, 1 after.

        Raises:
            UnknownNameError, IndexError, StoreError: as ``image`` does.
        """
        for camera in self.config.cameras:
            for kind in (*kinds, "depth"):
                self._readings.check_image(camera, kind, frame)
        rows = self._rows.several(indices).tolist()
        return self._readings.scenes(rows, self.config.cameras, kinds, frame)

    def grasp_crop(
        self,
        index: int,
        shape: CropShape | None = None,
        T_world_tcp: ArrayLike | None = None,
        camera: str | None = None,
    ) -> GraspCrop:
        """Return the view around a grasp before the attempt, rotated and scaled to the gripper.

        Args:
            index: the index of the episode.
            shape: the shape of the crop; None for the default.
            T_world_tcp: any grasp in the episode's scene, (4, 4); None for the episode's own.
            camera: a key of ``config.cameras``; None for all of them together.

        Raises:
            UsageError: if ``T_world_tcp`` is not a rigid transform, or if it is None and the
                episode has no grasp.
            UnknownNameError, IndexError, StoreError: as ``image`` does.
        """
        for name in self.config.cameras if camera is None else (camera,):
            self._readings.check_image(name, "depth", 0)
        row = self._rows.committed(index)
        if T_world_tcp is not None:
            T_world_tcp = _pose(T_world_tcp)
        return self._readings.crop(row, camera, T_world_tcp, shape)

    def series(self, index: int, *names: str) -> dict[str, NDArray[Any]]:
        """Return some streams of one episode, without padding.

        No other streams are read, except those that noise needs.

        Raises:
            UnknownNameError: listing the streams.
        """
        return self._readings.series(self._rows.committed(index), names)


def _pose(T: ArrayLike) -> Array:
    """Return a rigid transform as an array, (4, 4).

    Raises:
        UsageError: if ``T`` is not a rigid transform.
    """
    try:
        pose = np.asarray(T, np.float64)
    except (TypeError, ValueError):
        pose = np.empty(0)
    is_pose = pose.shape == (4, 4) and np.isfinite(pose).all() and (pose[3] == [0, 0, 0, 1]).all()
    if not is_pose or not _is_rotation(pose[:3, :3]):
        valid = "a rigid transform, (4, 4), metres"
        raise UsageError(f"T_world_tcp: got {shown(T)}, valid: {valid}")
    return pose


def _is_rotation(R: Array) -> bool:
    return bool(np.allclose(R @ R.T, np.eye(3), atol=RIGID) and np.linalg.det(R) > 0.0)
