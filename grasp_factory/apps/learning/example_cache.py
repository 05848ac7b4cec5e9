"""Examples that were read once, kept in a temporary file that a loader's processes share.

Reading an image from a store and cropping it takes some 0.7 ms, as long as a training step does for
an example; from the second epoch on there is no need for it.
"""

from __future__ import annotations

import contextlib
import math
import os
import tempfile
import weakref
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from grasp_factory.policies.networks.inputs import Inputs


class KeptInputs:
    """The inputs of some of N examples, by their place; what does not fit is not kept.

    A byte for each place says whether its inputs are there; it is written after them, so that a
    process that finds it finds them whole. The file goes when the process that made it drops this.
    """

    def __init__(self, shapes: Mapping[str, tuple[int, ...]], count: int, most: int) -> None:
        """Begin with nothing.

        Args:
            shapes: Of one example's inputs, by name.
            count: Examples that there are.
            most: Bytes that the file may have.
        """
        self._shapes = dict(shapes)
        self._size = 4 * sum(math.prod(shape) for shape in shapes.values())
        self._room = min(count, most // (self._size + 1))
        self._file, self._path = -1, Path()
        with contextlib.suppress(OSError):  # no place for it: all is read each time
            opened, name = tempfile.mkstemp(prefix="grasp-factory-", suffix=".examples")
            self._file, self._path = opened, Path(name)
            weakref.finalize(self, _remove, opened, self._path, os.getpid())

    def __getstate__(self) -> dict[str, Any]:
        """Travel to another process, which opens the file for itself."""
        return {**self.__dict__, "_file": -1}

    def take(self, places: NDArray[np.int64]) -> tuple[dict[str, NDArray[np.float32]], Any]:
        """Return inputs of examples (K,), and which of them are kept, (K,); others hold anything.

        Args:
            places: 0 to N - 1.
        """
        file = self._opened()
        flags = np.zeros(self._room, np.uint8)
        said = np.frombuffer(os.pread(file, self._room, 0), np.uint8) if file >= 0 else flags[:0]
        flags[: len(said)] = said
        found = np.zeros(len(places), np.bool_)
        fits = places < self._room
        found[fits] = flags[places[fits]] == 1
        records = np.empty((len(places), self._size // 4), np.float32)
        for k in np.flatnonzero(found).tolist():
            record = memoryview(records[k]).cast("B")
            found[k] = os.preadv(file, [record], self._offset(int(places[k]))) == self._size
        parts = np.cumsum([math.prod(shape) for shape in self._shapes.values()])[:-1]
        columns = np.split(records, parts, axis=1)
        return {
            name: column.reshape(len(places), *shape)
            for (name, shape), column in zip(self._shapes.items(), columns, strict=True)
        }, found

    def keep(self, places: NDArray[np.int64], inputs: Inputs) -> None:
        """Keep the inputs of examples (K,), as far as there is room on the disk."""
        file = self._opened()
        if file < 0:
            return
        with contextlib.suppress(OSError):  # a full disk: it is read again the next time
            for k in np.flatnonzero(places < self._room).tolist():
                place = int(places[k])
                record = np.concatenate([inputs[name][k].ravel() for name in self._shapes])
                if os.pwrite(file, record.data, self._offset(place)) == self._size:
                    os.pwrite(file, b"\1", place)

    def _offset(self, place: int) -> int:
        return self._room + place * self._size

    def _opened(self) -> int:
        """Return the file's descriptor in this process; -1 where there is none."""
        if self._file < 0:
            with contextlib.suppress(OSError):
                self._file = os.open(self._path, os.O_RDWR | os.O_CLOEXEC)
                weakref.finalize(self, os.close, self._file)
        return self._file


def _remove(opened: int, path: Path, maker: int) -> None:
    """Close and remove the file; a forked process has it closed alone."""
    os.close(opened)
    if os.getpid() == maker:
        path.unlink(missing_ok=True)
