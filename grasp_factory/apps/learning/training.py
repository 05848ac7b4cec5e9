"""Fit a network with a fixed seed and mirrored examples, and keep its best epoch on val."""

from __future__ import annotations

import copy
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from sklearn.linear_model import LogisticRegression
from torch import Tensor
from torch.nn.functional import binary_cross_entropy_with_logits

from grasp_factory.apps.learning.examples import Examples
from grasp_factory.apps.learning.progress_callback import ProgressWatch, unwatched
from grasp_factory.core.geometry import Array
from grasp_factory.core.serialization import check, check_range
from grasp_factory.errors import UsageError
from grasp_factory.policies.networks import KINDS, GraspModel, Inputs, TouchWindow, mirrored, take
from grasp_factory.policies.networks.nets import GraspNet
from grasp_factory.signals.grasp_crop import CropShape


@dataclass(frozen=True, slots=True, kw_only=True)
class TrainSettings:
    """How networks are fitted. The defaults suit hundreds to tens of thousands of examples."""

    seed: int = 0
    epochs: int = 20
    """Largest number of epochs; the learning rate falls to 0 over them."""
    patience: int = 8
    """Fitting ends after this number of epochs without a better loss on val."""
    batch: int = 64
    learning_rate: float = 3e-3
    weight_decay: float = 1e-2
    smoothing: float = 0.02
    """Distance of the smoothed labels from 0 and 1."""
    threads: int = 1
    """Threads of torch; another number may change the last bits of the weights. These small
    networks gain little from two threads, and lose much if other processes use the cores."""

    def __post_init__(self) -> None:
        check_range(self, "seed", 0, 2**63 - 1)
        check_range(self, "epochs", 1, 10_000)
        check_range(self, "patience", 1, 10_000)
        check_range(self, "batch", 2, 65_536)
        check_range(self, "learning_rate", 1e-8, 10.0)
        check_range(self, "weight_decay", 0.0, 10.0)
        check_range(self, "smoothing", 0.0, 0.49)
        check_range(self, "threads", 1, 1024)


@dataclass(frozen=True, slots=True, kw_only=True)
class Trained:
    """A fitted network, and the history of its fitting."""

    model: GraspModel
    val_loss: tuple[float, ...] = field(default_factory=tuple)
    """Mean cross-entropy on val after each epoch, nats."""
    best_epoch: int = 0
    """The epoch whose weights the model has, from 0."""


def fit(
    kind: str,
    train: Examples,
    val: Examples,
    settings: TrainSettings,
    *,
    crop: CropShape,
    touch: TouchWindow,
    facts: Mapping[str, Any],
    watch: ProgressWatch = unwatched,
) -> Trained:
    """Fit a network; the same arguments yield the same weights on the same machine.

    Args:
        kind: One of ``KINDS``.
        train: Examples to learn from.
        val: Examples of other objects, to choose the epoch and to calibrate the probabilities.
        settings: How to fit.
        crop: Shape of the images among the inputs.
        touch: Window of the touch among the inputs.
        facts: Facts about the fitting that the model records.
        watch: Reports each epoch.

    Raises:
        UsageError: if either part has examples of one class only.
    """
    for name, part in (("train", train), ("val", val)):
        _check_classes(name, part)
    check(len(train) >= 2, "train", len(train), "two examples at least")
    before = torch.get_num_threads(), torch.get_rng_state()
    torch.set_num_threads(settings.threads)
    torch.manual_seed(settings.seed)
    try:
        network = GraspNet(KINDS[kind], crop.size)
        model = GraspModel(kind=kind, crop=crop, touch=touch, network=network, facts=facts)
        losses, best = _descend(model, train, val, settings, watch)
    finally:
        torch.set_num_threads(before[0])
        torch.set_rng_state(before[1])
    slope, offset = _calibration(model.raw_logits(val.inputs), val.success)
    model = GraspModel(
        kind=kind, crop=crop, touch=touch, network=network, slope=slope, offset=offset, facts=facts
    )
    return Trained(model=model, val_loss=tuple(losses), best_epoch=best)


def _descend(
    model: GraspModel, train: Examples, val: Examples, settings: TrainSettings, watch: ProgressWatch
) -> tuple[list[float], int]:
    """Fit the network and load its best weights; return the losses on val and the best epoch."""
    network, rng = model.network, np.random.default_rng(settings.seed)
    optimizer = torch.optim.AdamW(
        network.parameters(), settings.learning_rate, weight_decay=settings.weight_decay
    )
    batches = max(1, len(train) // settings.batch)
    schedule = torch.optim.lr_scheduler.OneCycleLR(
        optimizer, settings.learning_rate, total_steps=settings.epochs * batches
    )
    losses: list[float] = []
    best, weights = 0, copy.deepcopy(network.state_dict())
    with watch(f"fitting {model.kind}", settings.epochs) as step:
        for epoch in range(settings.epochs):
            network.train()
            for inputs, target in _batches(model, train, settings, rng):
                optimizer.zero_grad()
                binary_cross_entropy_with_logits(network(inputs), target).backward()  # type: ignore[no-untyped-call]
                optimizer.step()
                schedule.step()
            network.eval()
            losses.append(cross_entropy(model.raw_logits(val.inputs), val.success))
            if losses[epoch] <= min(losses):
                best, weights = epoch, copy.deepcopy(network.state_dict())
            step()
            if epoch - best >= settings.patience:
                break
    network.load_state_dict(weights)
    network.eval()
    return losses, best


def _batches(
    model: GraspModel, train: Examples, settings: TrainSettings, rng: np.random.Generator
) -> Iterator[tuple[dict[str, Tensor], Tensor]]:
    """Yield an epoch's full batches in random order; the remaining examples are left out."""
    used = {name: train.inputs[name] for name in model.uses}
    order = rng.permutation(len(train))
    size = min(settings.batch, len(train))
    for start in range(0, len(order) - size + 1, size):
        rows = order[start : start + size]
        seen = mirrored(take(used, rows), rng.random(size) < 0.5, rng.random(size) < 0.5)
        target = train.success[rows] * (1.0 - 2.0 * settings.smoothing) + settings.smoothing
        yield _tensors(seen), torch.from_numpy(target.astype(np.float32))


def _tensors(inputs: Inputs) -> dict[str, Tensor]:
    return {n: torch.from_numpy(np.ascontiguousarray(values)) for n, values in inputs.items()}


def cross_entropy(logits: Array, success: NDArray[np.bool_]) -> float:
    """Return the mean cross-entropy of logits (K,), nats."""
    return float(np.mean(np.logaddexp(0.0, logits) - success * logits))


def _calibration(logits: Array, success: NDArray[np.bool_]) -> tuple[float, float]:
    """Return slope and offset that make logits (K,) log odds, by Platt's regression (1999)."""
    fitted = LogisticRegression(C=1e3).fit(logits[:, None], success)
    slope, offset = float(fitted.coef_[0, 0]), float(fitted.intercept_[0])
    if slope > 0.0:
        return slope, offset
    # A network that learned nothing may rank val worse than a random order does. Its order is
    # not reversed for that.
    rate = float(success.mean())
    return 1.0, float(np.log(rate / (1.0 - rate)) - logits.mean())


def _check_classes(name: str, part: Examples) -> None:
    good = int(part.success.sum())
    if not 0 < good < len(part):
        raise UsageError(
            f"{name}: {good} of {len(part)} usable episodes are a success; valid: some of both"
            " kinds; generate more episodes"
        )
