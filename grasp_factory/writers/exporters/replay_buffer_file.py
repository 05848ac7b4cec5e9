"""A replay buffer as a zip of Zarr version 2: arrays over the steps of all episodes.

It is joined from files with the images, encoded already, and files with the other arrays. A chunk
of images is one image, as in UMI's files.
"""

from __future__ import annotations

import zipfile
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import numcodecs  # type: ignore[import-untyped]
import numpy as np
import zarr
from numpy.typing import ArrayLike, NDArray

STEPS_PER_CHUNK = 1024
"""Of the arrays that are no images."""
_TIME = (1980, 1, 1, 0, 0, 0)
"""Of all files in a zip, so that bytes repeat; the earliest that a zip can hold."""


def codec() -> Any:
    """Return the codec of all chunks; numcodecs of 2022, which the projects name, reads it too.

    zarr lets Blosc use one thread; with several, the order of its blocks would vary.
    """
    return numcodecs.Blosc(cname="zstd", clevel=1, shuffle=numcodecs.Blosc.NOSHUFFLE)


def image_name(number: int) -> str:
    """Return the name of the array with the images of a camera; the first camera has number 0."""
    return f"camera{number}_rgb"


class FramesFile:
    """A zip with a part's images as chunks of the replay buffer; a context manager that closes it.

    The name of a chunk is its camera's array and its step in the part, as in ``camera0_rgb/17``.
    """

    def __init__(self, path: Path) -> None:
        """Create the file.

        Raises:
            OSError: if it cannot be created.
        """
        self._zip, self._codec = zipfile.ZipFile(path, "w"), codec()

    def add(self, camera: int, start: int, frames: NDArray[np.uint8]) -> None:
        """Add images (K, H, W, 3) of a camera, the part's steps from ``start`` on."""
        for step, frame in enumerate(frames, start):
            name = f"{image_name(camera)}/{step}"
            _add(self._zip, name, self._codec.encode(np.ascontiguousarray(frame)))

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self._zip.close()


def write_replay_buffer(
    path: Path,
    *,
    scratch: Path,
    frames: Sequence[Path],
    arrays: Sequence[Path],
    meta: Mapping[str, ArrayLike],
    attributes: Mapping[str, Any],
    resolution: tuple[int, int],
) -> None:
    """Write a replay buffer.

    Args:
        path: the zip to create.
        scratch: a folder to create, for files that are not kept.
        frames: the ``FramesFile`` of each part.
        arrays: the .npz file of each part, with arrays (steps of the part, ...) by name.
        meta: arrays of ``meta``; ``episode_ends`` is one of them.
        attributes: attributes of the root; ``cameras`` lists the cameras.
        resolution: width and height of the images, pixels.

    Raises:
        OSError: if it cannot be written.
    """
    root = zarr.create_group(scratch, zarr_format=2, attributes=dict(attributes))
    about, data = root.create_group("meta"), root.create_group("data")
    for name, values in meta.items():
        about.create_array(name, data=np.asarray(values), compressors=None)
    width, height = resolution
    steps = int(np.asarray(meta["episode_ends"])[-1])
    for number in range(len(attributes["cameras"])):
        shape, kind = (steps, height, width, 3), np.dtype(np.uint8)
        _create(data, image_name(number), shape, kind, chunk=1)
    starts = _write_arrays(data, steps, arrays)
    with zipfile.ZipFile(path, "w") as file:
        for found in sorted(found for found in scratch.rglob("*") if found.is_file()):
            _add(file, found.relative_to(scratch).as_posix(), found.read_bytes())
        for start, part in zip(starts, frames, strict=True):
            with zipfile.ZipFile(part) as images:
                for name in images.namelist():
                    array, step = name.split("/")
                    _add(file, f"data/{array}/{start + int(step)}.0.0.0", images.read(name))


def _write_arrays(data: zarr.Group, steps: int, parts: Iterable[Path]) -> list[int]:
    """Write the arrays that are no images, part by part; return the first step of each part."""
    arrays: dict[str, Any] = {}
    starts, start = list[int](), 0
    for part in _loaded(parts):
        for name, rows in part.items():
            if name not in arrays:
                shape = (steps, *rows.shape[1:])
                arrays[name] = _create(data, name, shape, rows.dtype, chunk=STEPS_PER_CHUNK)
            arrays[name][start : start + len(rows)] = rows
        starts.append(start)
        start += len(rows)
    return starts


def _loaded(parts: Iterable[Path]) -> Iterator[dict[str, NDArray[Any]]]:
    for path in parts:
        with np.load(path, allow_pickle=False) as arrays:
            yield dict(arrays)


def _create(
    group: zarr.Group, name: str, shape: tuple[int, ...], dtype: np.dtype[Any], *, chunk: int
) -> Any:
    chunks = (min(chunk, shape[0]), *shape[1:])
    return group.create_array(name, shape=shape, chunks=chunks, dtype=dtype, compressors=codec())


def _add(file: zipfile.ZipFile, name: str, data: bytes) -> None:
    """Add a file to a zip, without compression."""
    file.writestr(zipfile.ZipInfo(name, _TIME), data)
