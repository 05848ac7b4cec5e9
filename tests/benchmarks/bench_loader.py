"""How quickly a loader feeds a training step, against the same examples in memory.

    PYTHONPATH=tests python -m benchmarks.bench_loader grasps.zarr [OPTIONS]

A store of 640 x 480 pixels, such as `grasp-factory generate --n 2048` makes. In a round each
feeds one epoch of steps of the `vision` network; the ratio is that of the same round, so that what
else the machine does hits both. The page cache is warm.
"""

from __future__ import annotations

import argparse
import os
import statistics
import time
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any

import torch
from torch import Tensor
from torch.nn.functional import binary_cross_entropy_with_logits
from torch.utils.data import DataLoader

from grasp_factory.dataset.dataset import Dataset
from grasp_factory.policies.networks import KINDS
from grasp_factory.policies.networks.nets import GraspNet
from grasp_factory.torch import GraspDataset, GraspStream

BATCH = 64
WORKERS = 2
Batch = Mapping[str, Tensor]


class Trainer:
    """The network and its optimiser."""

    def __init__(self, size: int) -> None:
        torch.manual_seed(0)
        self._net = GraspNet(KINDS["vision"], size).train()
        self._optimizer = torch.optim.AdamW(self._net.parameters(), 1e-3)

    def step(self, batch: Batch) -> None:
        self._optimizer.zero_grad()
        binary_cross_entropy_with_logits(self._net(batch), batch["success"]).backward()
        self._optimizer.step()

    def speed(self, batches: Iterable[Batch]) -> float:
        """Return examples per second over some batches."""
        started, count = time.perf_counter(), 0
        for batch in batches:
            self.step(batch)
            count += len(batch["success"])
        return count / (time.perf_counter() - started)


class InMemory:
    """All examples in tensors, in random batches."""

    def __init__(self, examples: GraspDataset) -> None:
        items = examples.__getitems__(range(len(examples)))
        self._all = {n: torch.stack([item[n] for item in items]) for n in items[0] if n != "row"}

    def __iter__(self) -> Iterator[Batch]:
        for chosen in torch.randperm(len(self._all["success"])).split(BATCH):
            yield {name: values[chosen] for name, values in self._all.items()}


def worker_seconds(loader: DataLoader[Any]) -> float:
    """Return the CPU time that a loader's workers have taken so far."""
    ticks = 0
    for worker in loader._iterator._workers:  # type: ignore[union-attr]  # torch has no public way
        fields = Path(f"/proc/{worker.pid}/stat").read_text(encoding="utf-8").rsplit(")", 1)[1]
        ticks += sum(map(int, fields.split()[11:13]))
    return ticks / os.sysconf("SC_CLK_TCK")


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("store", type=Path)
    parser.add_argument("--rows", type=int, default=2048)
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--threads", type=int, default=torch.get_num_threads())
    arguments = parser.parse_args()
    torch.set_num_threads(arguments.threads)
    dataset = Dataset(arguments.store)
    examples = GraspDataset(dataset[dataset.committed[: arguments.rows]])
    loading: dict[str, Any] = {"batch_size": BATCH, "num_workers": WORKERS}
    loading["persistent_workers"] = True
    unkept = GraspDataset(dataset[dataset.committed[: arguments.rows]], keep_bytes=0)
    loaders = {
        "GraspDataset, first epoch": DataLoader(unkept, shuffle=True, **loading),
        "GraspStream, first epoch": DataLoader(GraspStream(unkept), **loading),
        f"GraspDataset, {WORKERS} workers": DataLoader(examples, shuffle=True, **loading),
        f"GraspStream, {WORKERS} workers": DataLoader(GraspStream(examples), **loading),
    }
    feeds: dict[str, Iterable[Batch]] = {"in memory": InMemory(examples), **loaders}
    trainer = Trainer(48)
    for feed in feeds.values():
        trainer.speed(feed)  # warms the page cache, and starts the workers
    read = {name: -worker_seconds(loader) for name, loader in loaders.items()}
    speeds: dict[str, list[float]] = {name: [] for name in feeds}
    stepping = 0.0
    for number in range(arguments.rounds):
        examples.set_epoch(number)
        unkept.set_epoch(number)
        for name, feed in feeds.items():
            before = time.process_time()
            speeds[name].append(trainer.speed(feed))
            stepping += (name == "in memory") * (time.process_time() - before)
    count = arguments.rounds * len(examples)
    burnt = {"in memory": stepping / count}
    for name, loader in loaders.items():
        burnt[name] = (read[name] + worker_seconds(loader)) / count
    width, height = dataset.config.resolution
    print(f"{len(examples)} examples, {width}x{height}, {os.cpu_count()} cores, "
          f"{arguments.threads} threads in the step, load {os.getloadavg()[0]:.1f}")  # fmt: skip
    print(
        f"{'into a training step':26}{'per second':>11}{'CPU each':>11}{'of memory':>11}   rounds"
    )
    for name, each in speeds.items():
        ratios = [a / b for a, b in zip(each, speeds["in memory"], strict=True)]
        print(f"{name:26}{statistics.median(each):>11.0f}{1e3 * burnt[name]:>8.2f} ms"
              f"{statistics.median(ratios):>11.2f}   "
              + " ".join(f"{ratio:.2f}" for ratio in ratios))  # fmt: skip
    print("CPU: the step's for what is in memory, the workers' for what they read")


if __name__ == "__main__":
    main()
