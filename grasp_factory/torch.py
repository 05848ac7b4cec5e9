"""Episodes for PyTorch: a dataset by index, and a stream that shuffles by block.

Nothing of a store is copied; a loader's workers open it themselves.
"""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import ArrayLike, NDArray
from torch import Tensor
from torch.utils.data import Dataset as TorchDataset
from torch.utils.data import IterableDataset, get_worker_info

from grasp_factory.apps.learning.example_cache import KeptInputs
from grasp_factory.apps.learning.examples import ExampleReader
from grasp_factory.core.serialization import is_integer
from grasp_factory.dataset.dataset import Dataset
from grasp_factory.errors import UsageError, shown
from grasp_factory.policies.networks.inputs import KINDS, Inputs, TouchWindow, mirrored
from grasp_factory.signals.grasp_crop import CropShape
from grasp_factory.signals.noise import SensorNoise

Example = dict[str, Any]
"""``image`` (3, S, S), ``width`` (1,), ``touch`` (2, 6, R), those that are used, and ``success``
(): float32 tensors; and ``row``, its number in the store."""

MOST_KEPT = 31 * 2**20
"""Bytes, just below the largest block whose release glibc learns from."""


class GraspDataset(TorchDataset[Example]):
    """A store's episodes as examples, by index.

    It holds the columns that it needs and reads the rest on demand. It may be pickled, and used by
    a ``DataLoader`` with any number of workers and either start method.
    """

    def __init__(
        self,
        store: Dataset | Path | str,
        rows: ArrayLike | None = None,
        *,
        uses: Sequence[str] = KINDS["vision"],
        crop: CropShape | None = None,
        touch: TouchWindow | None = None,
        noise: str | SensorNoise | None = None,
        noise_seed: int = 0,
        mirror_seed: int | None = None,
        keep_bytes: int = 2**30,
    ) -> None:
        """Open a store.

        Args:
            store: The store, or where it is.
            rows: Row numbers, such as ``Dataset.split`` or ``balanced`` return; None for all.
            uses: Names of the inputs; ``networks.KINDS`` has those of each network.
            crop: Shape of the images; None for the default.
            touch: Instants of the touch; None for the default.
            noise: What sensors add, or its name in ``noise.NOISE``, drawn anew in each epoch:
                epoch e shows what ``Dataset.open(path, noise, noise_seed + e)`` does. A
                ``Dataset`` that is given has its own, the same in all epochs.
            noise_seed: Of epoch 0.
            mirror_seed: Mirror each example at random along the TCP's x and y, another way in each
                epoch; None for as they are.
            keep_bytes: Size of a temporary file in which examples are kept when they have been
                read once, 28 kB each with an image, so that later epochs are quicker; 0 for none.
                With ``noise``, which differs between epochs, there is none.

        Raises:
            UsageError: for noise on an opened ``Dataset``, names or seeds that are none, or rows
                that hold no episode with a grasp.
            StoreError: if the store is damaged.
        """
        if isinstance(store, Dataset) and noise is not None:
            raise UsageError("noise: got one, and a Dataset, valid: one of them; give the path")
        if mirror_seed is not None:
            _check_number("mirror_seed", mirror_seed, 0)
        self._noise, self._noise_seed, self._mirror_seed = noise, noise_seed, mirror_seed
        dataset = store if isinstance(store, Dataset) else Dataset.open(store, noise, noise_seed)
        crop, touch = crop or CropShape(), touch or TouchWindow()
        self._reader = ExampleReader(dataset=dataset, uses=tuple(uses), crop=crop, touch=touch)
        self._grasps = self._reader.grasps(self._reader.usable(_rows(dataset, rows)))
        _check_number("keep_bytes", keep_bytes, 0)
        self._kept: KeptInputs | None = None
        if noise is None and keep_bytes:
            self._kept = KeptInputs(self._reader.shapes, len(self._grasps), keep_bytes)
        self._epoch = torch.zeros((), dtype=torch.int64).share_memory_()  # type: ignore[no-untyped-call]
        self._read_epoch = 0

    def __setstate__(self, state: dict[str, Any]) -> None:
        """Share the epoch's number again: a copy's workers hear of it, too."""
        self.__dict__.update(state)
        self._epoch.share_memory_()

    @property
    def rows(self) -> NDArray[np.int64]:
        """The store's row of each example, (K,), ascending.

        Rows without a grasp are left out, and with touch those that did not get to the lift.
        """
        return self._grasps.rows

    @property
    def blocks(self) -> NDArray[np.int64]:
        """The store's block of each example, (K,)."""
        return self.rows // self._reader.dataset.config.block_size

    @property
    def epoch(self) -> int:
        """The epoch's number, from 0 on."""
        return int(self._epoch)

    def set_epoch(self, epoch: int) -> None:
        """Draw noise and mirrorings anew, in workers that are kept between epochs as well."""
        _check_number("epoch", epoch, 0)
        self._epoch.fill_(epoch)

    def __len__(self) -> int:
        """Return the number of examples."""
        return len(self._grasps)

    def __getitem__(self, index: int) -> Example:
        """Return one example."""
        return self.__getitems__([index])[0]

    def __getitems__(self, indices: Sequence[int]) -> list[Example]:
        """Return some examples, in the order of their indices, opening a block's files once.

        Raises:
            IndexError: naming the valid range.
            StoreError: if one is damaged.
        """
        if get_worker_info() is not None:
            _keep_freed_memory(os.getpid())
        places = np.array([self._place(index) for index in indices], np.int64)
        grasps, inputs = self._grasps.take(places), self._inputs(places)
        if self._mirror_seed is not None:
            inputs = mirrored(inputs, *self._sides(self._mirror_seed, places))
        tensors = {n: torch.from_numpy(np.ascontiguousarray(v)) for n, v in inputs.items()}
        tensors["success"] = torch.from_numpy(grasps.success.astype(np.float32))
        return [
            {name: values[k] for name, values in tensors.items()} | {"row": row}
            for k, row in enumerate(grasps.rows.tolist())
        ]

    def _inputs(self, places: NDArray[np.int64]) -> Inputs:
        """Return what is shown of some examples, reading what is not kept."""
        reader = self._at_epoch()
        if self._kept is None:
            return reader.inputs(self._grasps.take(places))
        inputs, found = self._kept.take(places)
        if not found.all():
            missing = np.flatnonzero(~found)
            fresh = reader.inputs(self._grasps.take(places[missing]))
            self._kept.keep(places[missing], fresh)
            for name, values in fresh.items():
                inputs[name][missing] = values
        return inputs

    def _place(self, index: int) -> int:
        if not -len(self) <= index < len(self):
            raise IndexError(f"example {index}: valid: {-len(self)} to {len(self) - 1}")
        return index % len(self)

    def _sides(self, seed: int, places: NDArray[np.int64]) -> NDArray[np.bool_]:
        """Return which to mirror along x and along y, (2, K)."""
        drawn = [
            np.random.default_rng([seed, self.epoch, place]).random(2) for place in places.tolist()
        ]
        return np.reshape(drawn, (-1, 2)).T < 0.5

    def _at_epoch(self) -> ExampleReader:
        """Return the reader of this epoch's noise."""
        epoch = self.epoch
        if self._noise is not None and epoch != self._read_epoch:
            path, seed = self._reader.dataset.path, self._noise_seed + epoch
            self._reader = replace(self._reader, dataset=Dataset.open(path, self._noise, seed))
            self._read_epoch = epoch
        return self._reader


class GraspStream(IterableDataset[Example]):
    """The examples of a ``GraspDataset`` in random order, each once, read block by block.

    Blocks come in random order. Each is read at once, and its examples go into a pool, from which
    a random one leaves for each that comes. The blocks are shared out among a loader's workers
    and the ranks of distributed training; seed, epoch, rank and the numbers of ranks and
    workers decide the order, nothing else does.
    """

    def __init__(
        self,
        examples: GraspDataset,
        *,
        seed: int = 0,
        pool: int = 256,
        rank: int = 0,
        world_size: int = 1,
    ) -> None:
        """Stream a dataset.

        Args:
            examples: What to stream; its epoch is the stream's.
            seed: Of the order.
            pool: Examples in a worker's pool; 1 leaves a block's together.
            rank: Of this process in distributed training.
            world_size: Processes there. Their numbers of examples differ by some blocks' at most.

        Raises:
            UsageError: for numbers out of their range.
        """
        _check_number("seed", seed, 0)
        _check_number("pool", pool, 1)
        _check_number("world_size", world_size, 1)
        if not is_integer(rank) or not 0 <= rank < world_size:
            raise UsageError(f"rank: got {shown(rank)}, valid: 0 to {world_size - 1}")
        self.examples = examples
        self._seed, self._pool = seed, pool
        self._rank, self._world_size = rank, world_size

    def set_epoch(self, epoch: int) -> None:
        """Draw the order anew, and what the dataset draws."""
        self.examples.set_epoch(epoch)

    def __iter__(self) -> Iterator[Example]:
        """Iterate over this worker's share of this rank's share."""
        worker = get_worker_info()
        workers, number = (worker.num_workers, worker.id) if worker else (1, 0)
        share = self._rank * workers + number
        blocks = self.examples.blocks
        parts = np.split(np.arange(len(blocks)), np.flatnonzero(np.diff(blocks)) + 1)
        drawn = [self._seed, self.examples.epoch]
        order = np.random.default_rng(drawn).permutation(len(parts))
        rng = np.random.default_rng([*drawn, share])
        pool: list[Example] = []
        for part in order[share :: self._world_size * workers]:
            for example in self.examples.__getitems__(parts[part].tolist()):
                if len(pool) < self._pool:
                    pool.append(_owned(example))
                    continue
                k = int(rng.integers(len(pool)))
                yield pool[k]
                pool[k] = _owned(example)
        for k in rng.permutation(len(pool)).tolist():
            yield pool[k]


def _owned(example: Example) -> Example:
    """Return an example that does not keep its whole block in memory."""
    return {n: v.clone() if isinstance(v, Tensor) else v for n, v in example.items()}


def _rows(dataset: Dataset, rows: ArrayLike | None) -> NDArray[np.int64] | None:
    """Return row numbers as an array.

    Raises:
        UsageError: for what is none, or naming the first that holds no episode.
    """
    if rows is None:
        return None
    numbers = np.asarray(rows)
    if numbers.ndim != 1 or (numbers.size and numbers.dtype.kind not in "iu"):
        raise UsageError(f"rows: got {shown(rows)}, valid: row numbers, as Dataset.where returns")
    for row in numbers[~np.isin(numbers, dataset.committed)][:1]:
        raise UsageError(f"rows: {row} holds no episode, valid: those of Dataset.committed")
    return numbers.astype(np.int64)


def _check_number(name: str, value: int, least: int) -> None:
    if not is_integer(value) or value < least:
        raise UsageError(f"{name}: got {shown(value)}, valid: a whole number from {least} on")


@cache
def _keep_freed_memory(process: int) -> None:
    """Have the process keep the memory that it frees, up to 60 MB of it.

    Each image is a megabyte, which glibc else returns to the system and gets back page by page;
    that can take as long as decoding. It learns to keep it when a large block is freed.
    """
    np.empty(MOST_KEPT, np.uint8)
