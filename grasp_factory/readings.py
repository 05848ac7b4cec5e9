"""What the sensors of stored episodes show: images and series, clean or with noise."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from grasp_factory.config import FactoryConfig
from grasp_factory.episode import EpisodeSpec
from grasp_factory.errors import lookup
from grasp_factory.noise import EpisodeNoise
from grasp_factory.schema import Field
from grasp_factory.writers.stored import StoredArray


class Readings:
    """Images and series of committed rows, none read that is not asked for (or noise needs)."""

    def __init__(
        self,
        config: FactoryConfig,
        arrays: Mapping[str, StoredArray],
        fields: Mapping[str, Field],
        noise: EpisodeNoise,
        spec: Callable[[int], EpisodeSpec],
    ) -> None:
        """Use a store's arrays and fields by path, and what returns the recipe of a row."""
        self._config, self._arrays, self._fields = config, arrays, fields
        self._noise, self._spec = noise, spec
        self._images: dict[str, dict[str, str]] = {camera: {} for camera in config.cameras}
        """Path by camera and kind."""
        for path, field in fields.items():
            if field.is_image and not field.is_video:
                _, camera, kind = path.split("/")
                self._images[camera][kind] = path

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
        intrinsics = self._arrays[f"cameras/{camera}/intrinsics"]
        for k, i in enumerate(rows):
            K, far = intrinsics.read(i, i + 1)[0], self._spec(i).cameras[camera].far
            images[k] = self._noise.image(
                images[k], K, far, index=i, camera=camera, kind=kind, frame=frame
            )
        return images

    def series(self, row: int, names: Iterable[str]) -> dict[str, NDArray[Any]]:
        """Return some streams of a row, unpadded, by name; see ``Dataset.series``."""
        streams = {p.removeprefix("streams/"): p for p in self._fields if p.startswith("streams/")}
        wanted = {name: lookup(streams, "stream", name) for name in names}
        n_steps = int(self._arrays["episodes/n_steps"].read(row, row + 1)[0])
        needed = [name for name in self._noise.needs(wanted) if name in streams]
        clean = {
            name: self._arrays[streams[name]].read(row, row + 1)[0][:n_steps] for name in needed
        }
        read = self._noise.streams(row, clean, self._config.record_hz)
        return {name: np.asarray(read[name]) for name in wanted}
