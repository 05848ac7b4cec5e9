"""Sensor data of stored episodes: images, series, clouds, crops; clean or with noise."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from grasp_factory.core.config.factory_config import FactoryConfig
from grasp_factory.core.enums import Outcome
from grasp_factory.core.episode import CameraImage, EpisodeSpec
from grasp_factory.core.geometry import Array, inverse, pose_matrices
from grasp_factory.core.real_columns import SOURCE, Source
from grasp_factory.core.schema import Field
from grasp_factory.core.serialization import is_integer
from grasp_factory.dataset.plausible import check_calibration, check_recipe
from grasp_factory.dataset.row_codec import unpadded
from grasp_factory.errors import ConfigError, StoreError, UsageError, lookup
from grasp_factory.signals.grasp_crop import CropShape, GraspCrop, grasp_crop
from grasp_factory.signals.noise import EpisodeNoise
from grasp_factory.signals.point_cloud import FRAMES, PointCloud, joined, label_mask, visible_cloud
from grasp_factory.writers.zarr.array_reader import StoredArray
from grasp_factory.writers.zarr.header import place_in

IMAGES = ("rgb", "depth", "segmentation")
_SPECS_AT_ONCE = 64


class Readings:
    """Reads images and series of committed rows: only those requested or needed for noise."""

    def __init__(
        self,
        store: Path,
        config: FactoryConfig,
        arrays: Mapping[str, StoredArray],
        fields: Mapping[str, Field],
        noise: EpisodeNoise,
    ) -> None:
        """Use the arrays and fields, by their path, of the store at ``store``."""
        self._store, self._config, self._noise = store, config, noise
        self._arrays, self._fields = arrays, fields
        self._images: dict[str, dict[str, str]] = {camera: {} for camera in config.cameras}
        """Path by camera and kind."""
        for path, field in fields.items():
            if field.is_image and not field.is_video:
                _, camera, kind = path.split("/")
                self._images[camera][kind] = path

    def spec(self, row: int) -> EpisodeSpec:
        """Return the recipe of a row that is not missing.

        Raises:
            StoreError: if it is damaged.
        """
        return self._recipe(row, str(self._value("episodes/spec", row)))

    def specs(self, rows: Sequence[int]) -> Iterator[EpisodeSpec]:
        """Yield the recipes of rows that are not missing; those of a block are read together.

        Raises:
            StoreError: if one is damaged.
        """
        for first in range(0, len(rows), _SPECS_AT_ONCE):
            part = rows[first : first + _SPECS_AT_ONCE]
            texts = self._values("episodes/spec", part)
            yield from map(self._recipe, part, map(str, texts))

    def _recipe(self, row: int, text: str) -> EpisodeSpec:
        try:
            spec = EpisodeSpec.from_json(text)
            check_recipe(spec, self._config)
            return spec
        except (ValueError, RecursionError) as error:  # ConfigError is a ValueError
            raise StoreError(f"{self._store}: episode {row} is damaged: {error}") from None

    def check_image(self, camera: str, kind: str, frame: int) -> None:
        """Check that the store has images of a camera and a kind, and that the frame is valid.

        Raises:
            UnknownNameError: listing the cameras, or the kinds.
            IndexError: for an invalid frame.
        """
        self.image_path(camera, kind)
        if not is_integer(frame) or frame not in (0, 1):
            raise IndexError(f"frame {frame}: valid: 0 (before) and 1 (after)")

    def image_path(self, camera: str, kind: str) -> str:
        """Return the path of the array of a camera's images.

        Raises:
            UnknownNameError: listing the cameras, or the kinds.
        """
        return lookup(lookup(self._images, "camera", camera), "image kind", kind)

    def images(self, rows: Sequence[int], camera: str, kind: str, frame: int) -> NDArray[Any]:
        """Return an image of each of K rows, (K, H, W, ...); see ``Dataset.images``."""
        images = self._arrays[self.image_path(camera, kind)].read_frames(rows, frame)
        if kind not in self._noise.images:
            return images
        for k, row in enumerate(rows):
            K, far = self._value(f"cameras/{camera}/intrinsics", row), self._far(row, camera)
            images[k] = self._noise.image(
                images[k], K, far, index=self._index(row), camera=camera, kind=kind, frame=frame
            )
        return images

    def _images_of(
        self, rows: Sequence[int], camera: str, kinds: Sequence[str], frame: int
    ) -> list[NDArray[Any]]:
        """Return a camera's images of some kinds; object storage is asked for all at a time."""
        paths = [self.image_path(camera, kind) for kind in kinds]
        reads = [partial(self.images, rows, camera, kind, frame) for kind in kinds]
        return place_in(self._arrays[paths[0]].zarr).root.at_once(reads) if paths else []

    def series(self, row: int, names: Iterable[str]) -> dict[str, NDArray[Any]]:
        """Return some streams of a row, unpadded, by name; see ``Dataset.series``."""
        streams = {p.removeprefix("streams/"): p for p in self._fields if p.startswith("streams/")}
        wanted = {name: lookup(streams, "stream", name) for name in names}
        column = "episodes/n_steps"
        n_steps = self._value(column, row)
        needed = [name for name in self._noise.needs(wanted) if name in streams]
        clean = {
            name: unpadded(self._value(streams[name], row), n_steps, row, column) for name in needed
        }
        read = self._noise.streams(self._index(row), clean, self._config.record_hz)
        return {name: np.asarray(read[name]) for name in wanted}

    def cloud(
        self, row: int, camera: str | None, frame: int, part: str, in_frame: str
    ) -> PointCloud:
        """Return the points of a row's scene that cameras see; see ``Dataset.point_cloud``."""
        lookup(FRAMES, "frame", in_frame)
        shown = label_mask(part, self._config.clutter.count)
        cameras = list(self._images) if camera is None else [camera]
        if in_frame == "camera" and len(cameras) > 1:
            valid = " or ".join(f"camera={name!r}" for name in cameras)
            raise UsageError(f"in_frame='camera': got no camera, valid: {valid}")
        self._check_calibrated(row, cameras, frame)
        T_world_frame = self._frame_pose(row, in_frame, cameras[0], frame)
        clouds = [
            visible_cloud(image, self._far(row, name), shown)
            for name, image in self.scenes([row], cameras, IMAGES, frame)[0].items()
        ]
        return joined(clouds).moved(inverse(T_world_frame))

    def crop(
        self, row: int, camera: str | None, T_world_tcp: Array | None, shape: CropShape | None
    ) -> GraspCrop:
        """Return what cameras see around a grasp before the attempt; see ``Dataset.grasp_crop``."""
        T = self._grasp_pose(row, "T_world_tcp=None") if T_world_tcp is None else T_world_tcp
        cameras = self._images if camera is None else (camera,)
        self._check_calibrated(row, cameras, 0)
        return grasp_crop(self.scenes([row], cameras, IMAGES, 0)[0].values(), T, shape)

    def calibrations(self, rows: Sequence[int], camera: str, frame: int) -> tuple[Array, Array]:
        """Return a camera's intrinsics (K, 3, 3) and its poses (K, 4, 4) in the world.

        Of real episodes they are NaN where they were not measured.

        Raises:
            StoreError: if no camera has such ones.
        """
        intrinsics = self._values(f"cameras/{camera}/intrinsics", rows)
        poses = self._values(f"cameras/{camera}/T_world_camera", rows)[:, frame]
        try:
            check_calibration(*(self._measured(values, rows) for values in (intrinsics, poses)))
        except ConfigError as error:
            what = f"the calibration of camera {camera!r} is damaged"
            raise StoreError(f"{self._store}: {what}: {error}") from None
        return intrinsics, poses

    def _measured(self, matrices: Array, rows: Sequence[int]) -> Array:
        """Return the matrices (K, n, n) without those of real episodes that were not measured."""
        if SOURCE not in self._fields:
            return matrices
        is_real = self._values(SOURCE, rows) == Source.REAL
        is_measured = ~(is_real & np.isnan(matrices).any(axis=(1, 2)))
        return np.asarray(matrices[is_measured])

    def _check_calibrated(self, row: int, cameras: Iterable[str], frame: int) -> None:
        """Check that the cameras' intrinsics and poses were measured.

        Raises:
            UsageError: naming a camera of which they were not.
        """
        for camera in cameras:
            if any(np.isnan(values).any() for values in self.calibrations([row], camera, frame)):
                raise UsageError(
                    f"episode {row} is real, and its camera {camera} has no intrinsics or no pose:"
                    " import it again with a calibration and the setting T_world_camera"
                )

    def scenes(
        self, rows: Sequence[int], cameras: Iterable[str], kinds: Sequence[str], frame: int
    ) -> list[dict[str, CameraImage]]:
        """Return what cameras see in each of K rows; see ``Dataset.scenes``."""
        scenes: list[dict[str, CameraImage]] = [{} for _ in rows]
        width, height = self._config.resolution
        for camera in cameras:
            read = dict(zip(kinds, self._images_of(rows, camera, kinds, frame), strict=True))
            rgb, depth, segmentation = (
                read[kind]
                if kind in kinds
                else np.broadcast_to(np.uint8(0), (len(rows), height, width, 3)[:dimensions])
                for kind, dimensions in (("rgb", 4), ("depth", 3), ("segmentation", 3))
            )
            intrinsics, poses = self.calibrations(rows, camera, frame)
            for k, scene in enumerate(scenes):
                scene[camera] = CameraImage(
                    rgb=rgb[k],
                    depth=depth[k],
                    segmentation=segmentation[k],
                    intrinsics=intrinsics[k],
                    T_world_camera=poses[k],
                )
        return scenes

    def _frame_pose(self, row: int, name: str, camera: str, frame: int) -> Array:
        """Return the world pose (4, 4) of one of ``FRAMES`` at the time of an image.

        Raises:
            UsageError: if the episode has no such pose, because nothing was planned or attempted.
        """
        if name == "world":
            return np.eye(4)
        if name == "camera":
            return self._camera_pose(row, camera, frame)
        if name == "grasp":
            return self._grasp_pose(row, "in_frame='grasp'")
        has_records = self._value("episodes/n_steps", row) > 0
        if name == "tcp":
            if not has_records:
                self._refuse(row, "in_frame='tcp'", "n_steps=Range(1)")
            return pose_matrices(self._at_image(row, "tcp_pose", frame))
        if frame == 0 or not has_records:
            return pose_matrices(self._value("episodes/object_rest_pose", row)[0])
        return pose_matrices(self._at_image(row, "object_pose", frame)[0])

    def _grasp_pose(self, row: int, asked: str) -> Array:
        position, quat = (
            self._value(f"episodes/grasp_{part}", row) for part in ("position", "quat_xyzw")
        )
        if np.isnan(position).any():
            self._refuse(row, asked, "grasp_width=Range(0.0)")
        return pose_matrices(np.concatenate([position, quat]))

    def _camera_pose(self, row: int, camera: str, frame: int) -> Array:
        return np.asarray(self._value(f"cameras/{camera}/T_world_camera", row)[frame])

    def _at_image(self, row: int, stream: str, frame: int) -> Any:
        """Return a stream's record for an image: the first before the attempt, the last after."""
        return self.series(row, [stream])[stream][0 if frame == 0 else -1]

    def _refuse(self, row: int, asked: str, condition: str) -> None:
        outcome = Outcome(int(self._value("episodes/outcome", row))).name.lower()
        what = f"{asked}: episode {row} has none (its outcome is {outcome})"
        raise UsageError(f"{what}, valid: rows of where({condition})")

    def _far(self, row: int, camera: str) -> float:
        return self.spec(row).cameras[camera].far

    def _index(self, row: int) -> int:
        """Return the index of a row's recipe, on which its noise depends."""
        path = "episodes/index"  # stores from before merging was added lack it
        return int(self._value(path, row)) if path in self._arrays else row

    def _values(self, path: str, rows: Sequence[int]) -> NDArray[Any]:
        return self._arrays[path].gather(np.asarray(rows, np.int64), self._config.block_size)

    def _value(self, path: str, row: int) -> Any:
        return self._arrays[path].read(row, row + 1)[0]
