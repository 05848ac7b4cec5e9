"""A cache of examples in a temporary file that a loader's processes share.

Reading an image from a store and cropping it takes about 0.7 ms, as long as a training step takes
for one example. From the second epoch on, cached examples need no reading and cropping.
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

_KEPT, _CLAIMED = 1, 2
"""Marks of a position: its inputs are in the file; a process has begun to read them."""


class KeptInputs:
    """The inputs of some of N examples, by position; examples that do not fit are not kept.

    One byte for each position marks its inputs as stored, or as being read. The first is written
    after the inputs, so a process that reads the mark also reads complete inputs. The file is
    removed when the process that made it releases this object.
    """

    def __init__(self, shapes: Mapping[str, tuple[int, ...]], count: int, most: int) -> None:
        """Create an empty cache.

        Args:
            shapes: Shape of each input of one example, by name.
            count: Number of examples, N.
            most: Largest size of the file in bytes.
        """
        self._shapes = dict(shapes)
        self._size = 4 * sum(math.prod(shape) for shape in shapes.values())
        self._room = min(count, most // (self._size + 1))
        self._file, self._path = -1, Path()
        with contextlib.suppress(OSError):  # no space for the file: every read goes to the store
            opened, name = tempfile.mkstemp(prefix="grasp-factory-", suffix=".examples")
            self._file, self._path = opened, Path(name)
            weakref.finalize(self, _remove, opened, self._path, os.getpid())

    def __getstate__(self) -> dict[str, Any]:
        """Return the state without the open file: another process opens the file itself."""
        return {**self.__dict__, "_file": -1}

    def take(self, places: NDArray[np.int64]) -> tuple[dict[str, NDArray[np.float32]], Any]:
        """Return the inputs of K examples, and which of them are kept, (K,).

        The inputs of the others are undefined.

        Args:
            places: Positions of the examples, (K,), 0 to N - 1.
        """
        file, flags = self._opened(), self._flags()
        found = np.zeros(len(places), np.bool_)
        fits = places < self._room
        found[fits] = flags[places[fits]] == _KEPT
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
        """Keep the inputs of K examples, as far as there is space in the file and on the disk."""
        file = self._opened()
        if file < 0:
            return
        with contextlib.suppress(OSError):  # a full disk: read it again next time
            for k in np.flatnonzero(places < self._room).tolist():
                place = int(places[k])
                record = np.concatenate([inputs[name][k].ravel() for name in self._shapes])
                if os.pwrite(file, record.data, self._offset(place)) == self._size:
                    os.pwrite(file, bytes([_KEPT]), place)

    def claim(self, places: NDArray[np.int64]) -> NDArray[np.int64]:
        """Return those of some positions whose inputs nobody keeps or reads; the caller reads them.

        Two processes that ask at the same instant may get the same ones, and read them twice. If
        the file cannot be written, nothing is returned, because nothing would be kept.
        """
        file = self._opened()
        free: NDArray[np.int64] = places[places < self._room]
        free = free[self._flags()[free] == 0]
        try:
            for place in free.tolist():
                os.pwrite(file, bytes([_CLAIMED]), place)
        except OSError:
            return places[:0]
        return free

    def _flags(self) -> NDArray[np.uint8]:
        """Return the mark of each position that there is space for."""
        file, flags = self._opened(), np.zeros(self._room, np.uint8)
        said = np.frombuffer(os.pread(file, self._room, 0), np.uint8) if file >= 0 else flags[:0]
        flags[: len(said)] = said
        return flags

    def _offset(self, place: int) -> int:
        return self._room + place * self._size

    def _opened(self) -> int:
        """Return the file's descriptor in this process; -1 if there is no file."""
        if self._file < 0:
            with contextlib.suppress(OSError):
                self._file = os.open(self._path, os.O_RDWR | os.O_CLOEXEC)
                weakref.finalize(self, os.close, self._file)
        return self._file


def runs_around(
    places: NDArray[np.int64], length: int, count: int, share: float
) -> list[NDArray[np.int64]]:
    """Return the runs of positions in which some positions lie, (length,) each, the last shorter.

    Args:
        places: the positions, 0 to count - 1.
        length: of a run; runs begin at its multiples.
        count: number of all positions.
        share: which part of the runs comes first, 0 to 1.
    """
    numbers = np.unique(places // length)
    turned = np.roll(numbers, -int(share * len(numbers)))
    return [np.arange(length * k, min(length * (k + 1), count)) for k in turned.tolist()]


def _remove(opened: int, path: Path, maker: int) -> None:
    """Close the file, and remove it in the process that made it; a forked one only closes it."""
    os.close(opened)
    if os.getpid() == maker:
        path.unlink(missing_ok=True)
