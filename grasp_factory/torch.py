"""Episodes for PyTorch: a dataset by index, and a stream that shuffles by block.

The store is not copied; each worker of a loader opens it itself.
"""

from __future__ import annotations

import contextlib
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor
from torch.utils.data import Dataset as TorchDataset
from torch.utils.data import IterableDataset, get_worker_info

from grasp_factory.apps.learning.example_cache import KeptInputs, runs_around
from grasp_factory.apps.learning.examples import AT_ONCE, ExampleReader
from grasp_factory.core.object_storage.address import is_remote
from grasp_factory.core.serialization import is_integer
from grasp_factory.dataset.dataset import Dataset
from grasp_factory.errors import GraspFactoryError, UsageError, shown
from grasp_factory.policies.networks.inputs import KINDS, Inputs, TouchWindow, mirrored
from grasp_factory.signals.grasp_crop import CropShape
from grasp_factory.signals.noise import SensorNoise, named_noise

Example = dict[str, Any]
"""The inputs that are used of ``image`` (3, S, S), ``width`` (1,) and ``touch`` (2, 6, R), and
``success`` (), all as float32 tensors; and ``row``, the example's row number in the store."""


class GraspDataset(TorchDataset[Example]):
    """A store's episodes as examples, by index.

    It holds the columns that it needs and reads the rest on demand. It can be pickled, and used by
    a ``DataLoader`` with any number of workers, which start by ``fork`` or ``spawn``.
    """

    def __init__(
        self,
        store: Dataset | Path | str,
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
            store: A dataset, a view of one, such as ``Dataset.split`` or ``balanced`` return, or
                the path of a store.
            uses: Names of the inputs; ``networks.KINDS`` has those of each network.
            crop: Shape of the images; None for the default.
            touch: Time window of the touch; None for the default.
            noise: Sensor noise, or its name in ``noise.NOISE``, drawn again in each epoch: epoch e
                has the noise of ``Dataset(path, noise, noise_seed + e)``. A dataset that was
                opened with noise has its own, the same in all epochs.
            noise_seed: Seed of the noise in epoch 0.
            mirror_seed: Seed for mirroring each example at random along the TCP's x and y, again in
                each epoch; None for no mirroring.
            keep_bytes: Largest size of a temporary file that keeps examples after their first
                reading, 28 kB each with an image, so that later epochs are faster; 0 for no file.
                From object storage, examples beside those that are asked for are read and kept too.
                With ``noise``, which differs between epochs, there is no file.

        Raises:
            UsageError: for noise with a dataset that has its own, invalid names or seeds, or if no
                episode has a grasp.
            StoreError: if the store is damaged.
        """
        if mirror_seed is not None:
            _check_number("mirror_seed", mirror_seed, 0)
        self._noise, self._noise_seed, self._mirror_seed = noise, noise_seed, mirror_seed
        dataset, rows = _opened(store, noise, noise_seed)
        crop, touch = crop or CropShape(), touch or TouchWindow()
        names = uses if isinstance(uses, str) else tuple(uses)  # a text is refused
        self._reader = ExampleReader(dataset=dataset, uses=names, crop=crop, touch=touch)
        self._grasps = self._reader.grasps(self._reader.usable(rows))
        _check_number("keep_bytes", keep_bytes, 0)
        self._kept: KeptInputs | None = None
        if noise is None and keep_bytes:
            self._kept = KeptInputs(self._reader.shapes, len(self._grasps), keep_bytes)
        self._reads_ahead = any(map(is_remote, dataset.paths))
        self._epoch = torch.zeros((), dtype=torch.int64).share_memory_()  # type: ignore[no-untyped-call]
        self._read_epoch = 0

    def __setstate__(self, state: dict[str, Any]) -> None:
        """Share the epoch's number again, so that the workers of a copy also see it change."""
        self.__dict__.update(state)
        self._epoch.share_memory_()

    @property
    def rows(self) -> NDArray[np.int64]:
        """The store's row of each example, (K,), ascending.

        Rows without a grasp are left out. With touch, so are rows that did not reach the lift.
        """
        return self._grasps.rows

    @property
    def blocks(self) -> NDArray[np.int64]:
        """The store's block of each example, (K,)."""
        return self.rows // self._reader.dataset.config.block_size

    @property
    def epoch(self) -> int:
        """The epoch's number, from 0."""
        return int(self._epoch)

    def set_epoch(self, epoch: int) -> None:
        """Set the epoch: noise and mirroring are drawn again, also in persistent workers."""
        _check_number("epoch", epoch, 0)
        self._epoch.fill_(epoch)

    def __repr__(self) -> str:
        names = ", ".join([*self._reader.uses, "success", "row"])
        stores = ", ".join(map(str, self._reader.dataset.paths))
        return f"GraspDataset({stores!r}): {len(self)} examples of {names}"

    def __len__(self) -> int:
        """Return the number of examples."""
        return len(self._grasps)

    def __getitem__(self, index: int) -> Example:
        """Return one example."""
        return self.__getitems__([index])[0]

    def __getitems__(self, indices: Sequence[int]) -> list[Example]:
        """Return some examples in the order of their indices; a block's files are opened once.

        Raises:
            IndexError: naming the valid range.
            StoreError: if an episode is damaged.
        """
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
        """Return the inputs of some examples; read those that are not kept."""
        reader = self._at_epoch()
        if self._kept is None:
            return reader.inputs(self._grasps.take(places))
        inputs, found = self._kept.take(places)
        if self._reads_ahead and not found.all():
            self._read_ahead(self._kept, places[~found])
            inputs, found = self._kept.take(places)
        if not found.all():
            missing = np.flatnonzero(~found)
            fresh = reader.inputs(self._grasps.take(places[missing]))
            self._kept.keep(places[missing], fresh)
            for name, values in fresh.items():
                inputs[name][missing] = values
        return inputs

    def _read_ahead(self, kept: KeptInputs, places: NDArray[np.int64]) -> None:
        """Read and keep the examples around some as well: few requests bring all of them.

        The workers of a loader begin at different ones, so that each reads a part.
        """
        worker = get_worker_info()
        share = worker.id / worker.num_workers if worker else 0.0
        for run in runs_around(places, AT_ONCE, len(self), share):
            if len(free := kept.claim(run)):
                with contextlib.suppress(GraspFactoryError):  # one beside it may be damaged
                    kept.keep(free, self._reader.inputs(self._grasps.take(free)))

    def _place(self, index: int) -> int:
        if not -len(self) <= index < len(self):
            raise IndexError(f"example {index}: valid: {-len(self)} to {len(self) - 1}")
        return index % len(self)

    def _sides(self, seed: int, places: NDArray[np.int64]) -> NDArray[np.bool_]:
        """Return which examples to mirror along x and along y, (2, K)."""
        drawn = [
            np.random.default_rng([seed, self.epoch, place]).random(2) for place in places.tolist()
        ]
        return np.reshape(drawn, (-1, 2)).T < 0.5

    def _at_epoch(self) -> ExampleReader:
        """Return the reader with this epoch's noise."""
        epoch = self.epoch
        if self._noise is not None and epoch != self._read_epoch:
            paths, seed = self._reader.dataset.paths, self._noise_seed + epoch
            self._reader = replace(self._reader, dataset=Dataset(paths, self._noise, seed))
            self._read_epoch = epoch
        return self._reader


class GraspStream(IterableDataset[Example]):
    """The examples of a ``GraspDataset`` in random order, each once, read block by block.

    Blocks come in random order. Each block is read in one call, and its examples go into a pool.
    When the pool is full, each new example replaces a random one, which is yielded. The blocks are
    divided among a loader's workers and the ranks of distributed training. The order depends only
    on seed, epoch, rank and the numbers of ranks and workers.
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
            examples: The dataset to stream; its epoch is the stream's epoch.
            seed: Seed of the order.
            pool: Size of a worker's pool; with 1, the examples of a block stay together.
            rank: Rank of this process in distributed training.
            world_size: Number of these processes. Their shares differ by the examples of a few
                blocks at most.

        Raises:
            UsageError: for numbers out of range.
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
        """Set the epoch: the order and the dataset's noise and mirroring are drawn again."""
        self.examples.set_epoch(epoch)

    def __iter__(self) -> Iterator[Example]:
        """Iterate over the examples of this worker, a part of those of this rank."""
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
    """Return a copy of an example, so that the whole block does not stay in memory."""
    return {n: v.clone() if isinstance(v, Tensor) else v for n, v in example.items()}


def _opened(
    store: Dataset | Path | str, noise: str | SensorNoise | None, noise_seed: int
) -> tuple[Dataset, NDArray[np.int64]]:
    """Return a whole store, with noise, and the rows of its episodes that are asked for, (K,).

    Raises:
        UsageError: for noise with a dataset that has its own.
    """
    if not isinstance(store, Dataset):
        whole = Dataset(store, noise, noise_seed)
        return whole, whole.committed
    rows = store.indices[store.committed]
    if noise is None:
        return store.whole, rows
    if store.noise.noise != named_noise(None):
        raise UsageError("noise: got one, and a Dataset that was opened with its own, valid: one")
    return Dataset(store.paths, noise, noise_seed), rows


def _check_number(name: str, value: int, least: int) -> None:
    if not is_integer(value) or value < least:
        raise UsageError(f"{name}: got {shown(value)}, valid: a whole number from {least} on")
