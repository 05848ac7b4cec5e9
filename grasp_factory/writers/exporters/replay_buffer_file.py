"""A replay buffer as a zip of Zarr version 2: arrays over the steps of all episodes.

It is joined from files with the images, encoded already, and files with the other arrays. A chunk
of images is one image, as in UMI's files.
"""

from __future__ import annotations

import zipfile
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
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


@dataclass(frozen=True, slots=True, kw_only=True)
class BufferPart:
    """Some steps of a replay buffer, which follow those of the part before it."""

    steps: int
    frames: Path
    """A ``FramesFile``."""
    arrays: Path
    """A .npz file with the arrays that are no images, (steps, ...), by name."""


def write_replay_buffer(
    path: Path,
    parts: Sequence[BufferPart],
    *,
    meta: Mapping[str, ArrayLike],
    attributes: Mapping[str, Any],
    resolution: tuple[int, int],
) -> None:
    """Write a replay buffer.

    Args:
        path: the zip to create.
        parts: the parts, in order, one or more.
        meta: arrays of ``meta``; ``episode_ends`` is one of them.
        attributes: attributes of the root; ``cameras`` lists the cameras.
        resolution: width and height of the images, pixels.

    Raises:
        OSError: if it cannot be written.
    """
    width, height = resolution
    image = np.empty((0, height, width, 3), np.uint8)
    images = {image_name(number): (image, 1) for number in range(len(attributes["cameras"]))}
    with np.load(parts[0].arrays, allow_pickle=False) as first:
        others = {name: (rows, STEPS_PER_CHUNK) for name, rows in first.items()}
    steps = sum(part.steps for part in parts)
    with zipfile.ZipFile(path, "w") as file:
        for name, data in _metadata(images | others, steps, meta, attributes).items():
            _add(file, name, data)
        for name in others:
            for number, chunk in enumerate(_chunks(parts, name)):
                position = ".".join([str(number), *("0" for _ in chunk.shape[1:])])
                _add(file, f"data/{name}/{position}", codec().encode(chunk))
        start = 0
        for part in parts:
            with zipfile.ZipFile(part.frames) as frames:
                for name in frames.namelist():
                    array, step = name.split("/")
                    _add(file, f"data/{array}/{start + int(step)}.0.0.0", frames.read(name))
            start += part.steps


def _metadata(
    arrays: Mapping[str, tuple[NDArray[Any], int]],
    steps: int,
    meta: Mapping[str, ArrayLike],
    attributes: Mapping[str, Any],
) -> dict[str, bytes]:
    """Return the files of a replay buffer without the chunks of ``data``, by name.

    They are made in memory: when the disk fails, other threads of zarr go on writing for a while.

    Args:
        arrays: some rows of each array of ``data``, and the number of steps in its chunks.
        steps: number of all steps.
        meta: arrays of ``meta``.
        attributes: attributes of the root.
    """
    files: dict[str, Any] = {}
    store = zarr.storage.MemoryStore(files)
    root = zarr.create_group(store, zarr_format=2, attributes=dict(attributes))
    about, data = root.create_group("meta"), root.create_group("data")
    for name, values in meta.items():
        about.create_array(name, data=np.asarray(values), compressors=None)
    for name, (rows, length) in arrays.items():
        shape, chunks = (steps, *rows.shape[1:]), (length, *rows.shape[1:])
        data.create_array(name, shape=shape, chunks=chunks, dtype=rows.dtype, compressors=codec())
    return {name: files[name].to_bytes() for name in sorted(files)}


def _chunks(parts: Sequence[BufferPart], name: str) -> Iterator[NDArray[Any]]:
    """Yield the chunks of an array that is no images; the last is filled with zeros."""
    rest: list[NDArray[Any]] = []
    for part in parts:
        with np.load(part.arrays, allow_pickle=False) as arrays:
            rest.append(arrays[name])
        if sum(map(len, rest)) >= STEPS_PER_CHUNK:
            rows = np.concatenate(rest)
            whole = len(rows) - len(rows) % STEPS_PER_CHUNK
            yield from np.split(rows[:whole], whole // STEPS_PER_CHUNK)
            rest = [rows[whole:]]
    rows = np.concatenate(rest)
    if len(rows):
        chunk = np.zeros((STEPS_PER_CHUNK, *rows.shape[1:]), rows.dtype)
        chunk[: len(rows)] = rows
        yield chunk


def _add(file: zipfile.ZipFile, name: str, data: bytes) -> None:
    """Add a file to a zip, without compression."""
    file.writestr(zipfile.ZipInfo(name, _TIME), data)
