"""Reading episodes of a LeRobot dataset of ours back: windows and extras become series again."""

from __future__ import annotations

import os
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import NDArray

from grasp_factory.core.limits import IMPORT_FILE
from grasp_factory.core.place import Place
from grasp_factory.core.schema import shape, sizes
from grasp_factory.core.sensors import VIDEOS
from grasp_factory.writers.exporters.base import ExportFolder, episodes_of_each_file
from grasp_factory.writers.exporters.images import decode_png
from grasp_factory.writers.exporters.lerobot.features import IMAGES, own_series, windowed_series
from grasp_factory.writers.exporters.lerobot.lerobot_settings import IMAGE
from grasp_factory.writers.exporters.lerobot.numbering import DATA, EXTRAS, file_name


def read_back(folder: ExportFolder, place: int) -> dict[str, NDArray[Any]]:
    """Return the series of an episode by path; images only if they are stored as PNG.

    In a store that may hold real episodes, frames are not the images that a camera took, so nothing
    of the videos is returned.

    Args:
        folder: the export.
        place: the episode's number.

    Raises:
        ValueError, OSError: if a file is not as the export wrote it.
        LimitError: if it is too large.
    """
    in_a_file = episodes_of_each_file(folder.episodes, folder.settings.episodes_per_file)
    part, row = divmod(place, in_a_file)
    data, extras = (folder.place / file_name(name, ".parquet", part) for name in (DATA, EXTRAS))
    size, own = sizes(folder.config, folder.joints), list(own_series(folder))
    series = [one for one in windowed_series(folder) if _is_exact(folder, one.field.path)]
    has_images = folder.settings.video == IMAGE and not folder.config.capture
    cameras = folder.config.cameras if has_images else ()
    try:
        frames = _row_group(data, row, [one.name for one in series] + [*map(_image, cameras)])
        kept = [*(one.field for one in series), *own]
        after = _row(extras, row, [field.path for field in kept])
        found = {
            field.path: _numbers(after[field.path], shape(field, size)[1:]).astype(field.dtype)
            for field in own
        }
        for one in series:
            tail = shape(one.field, size)[1:]
            values = [
                _numbers(table[name], tail)
                for table, name in ((frames, one.name), (after, one.field.path))
            ]
            found[one.field.path] = np.concatenate(values).astype(one.field.dtype)
        return found | {f"videos/{name}/rgb": _images(folder, frames, name) for name in cameras}
    except pa.ArrowException as error:
        raise ValueError(f"{place}: {error}") from None


def _is_exact(folder: ExportFolder, path: str) -> bool:
    """Return whether frames have a series as it was in the store."""
    return not (folder.config.capture and path.startswith(f"{VIDEOS.name}/"))


def _image(camera: str) -> str:
    return f"{IMAGES}{camera}"


def _row_group(file: Place, number: int, names: list[str]) -> pa.Table:
    """Return the frames of an episode: each episode is a row group."""
    with os.fdopen(file.open(), "rb") as opened:
        IMPORT_FILE.check(os.fstat(opened.fileno()).st_size, file)
        return pq.ParquetFile(opened).read_row_group(number, columns=names)


def _row(file: Place, number: int, names: list[str]) -> pa.Table:
    """Return a row of a table."""
    with os.fdopen(file.open(), "rb") as opened:
        IMPORT_FILE.check(os.fstat(opened.fileno()).st_size, file)
        return pq.ParquetFile(opened).read(columns=names).slice(number, 1)


def _numbers(column: pa.ChunkedArray, tail: tuple[int, ...]) -> NDArray[Any]:
    """Return the numbers of a column of lists, (records, *tail)."""
    values = column.combine_chunks()
    while isinstance(values.type, pa.ListType | pa.FixedSizeListType):
        values = values.flatten()
    numbers: NDArray[Any] = values.to_numpy(zero_copy_only=False)
    return numbers.reshape(-1, *tail)


def _images(folder: ExportFolder, frames: pa.Table, camera: str) -> NDArray[np.uint8]:
    """Return the frames of a camera, (K, H, W, 3)."""
    width, height = folder.config.resolution
    size = (height, width, 3)
    found = [
        decode_png(image["bytes"], _image(camera), size, "uint8")
        for image in frames[_image(camera)].to_pylist()
    ]
    return np.stack(found) if found else np.empty((0, *size), np.uint8)
