"""What the sensors of stored episodes show: images and series, clean or with noise."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from grasp_factory.config import FactoryConfig
from grasp_factory.episode import EpisodeSpec
from grasp_factory.errors import StoreError, lookup, shown
from grasp_factory.noise import EpisodeNoise
from grasp_factory.records import is_integer
from grasp_factory.schema import Field
from grasp_factory.writers.stored import StoredArray


class Readings:
    """Images and series of committed rows, none read that is not asked for (or noise needs)."""

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

    def present_row(self, index: int) -> tuple[int, int]:
        """Return an episode's row, counted from the start, and its status.

        Raises:
            TypeError: for anything but an integer.
            IndexError: naming the valid range.
            StoreError: if the row is missing.
        """
        if not is_integer(index):
            what = f"episode index: got {shown(index)}, valid: one integer, as in ds[3]"
            raise TypeError(f"{what}; for several: where() and iter_blocks()")
        statuses = self._arrays["episodes/status"]
        size = statuses.zarr.shape[0]
        if not -size <= index < size:
            valid = f"valid: {-size} to {size - 1}" if size else "the store has no episodes"
            raise IndexError(f"episode {index}: {valid}")
        row = int(index) % size
        status = int(statuses.read(row, row + 1)[0])
        if status == 0:
            raise StoreError(f"{self._store}: episode {row} is missing")
        return row, status

    def committed_row(self, index: int) -> int:
        """Return the row of an episode that is not quarantined; see ``present_row``."""
        row, status = self.present_row(index)
        if status == 2:
            reason = self._arrays["episodes/error"].read(row, row + 1)[0]
            raise StoreError(f"{self._store}: episode {row} is quarantined: {reason}")
        return row

    def spec(self, row: int) -> EpisodeSpec:
        """Return the recipe of a row that is not missing.

        Raises:
            StoreError: if it is damaged.
        """
        text = str(self._arrays["episodes/spec"].read(row, row + 1)[0])
        try:
            return EpisodeSpec.from_json(text)
        except (ValueError, RecursionError) as error:  # ConfigError is a ValueError
            raise StoreError(f"{self._store}: episode {row} is damaged: {error}") from None

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
            K, far = intrinsics.read(i, i + 1)[0], self.spec(i).cameras[camera].far
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
