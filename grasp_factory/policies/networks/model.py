"""A trained network that predicts the probability that a grasp holds."""

# ruff: noqa: PLC0415

from __future__ import annotations

import copy
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from grasp_factory.core.elementary import exp
from grasp_factory.core.geometry import Array
from grasp_factory.policies.networks.inputs import KINDS, Inputs, TouchWindow, mirrored, take
from grasp_factory.signals.grasp_crop import CropShape

if TYPE_CHECKING:
    from grasp_factory.policies.networks.nets import GraspNet

CHUNK = 64
"""Grasps that go through the network together. Kernels are chosen by the shape, and with them the
last bits; so a chunk is always full, and a grasp's probability does not depend on the others."""
EXACT_CHUNK = 4
"""The same in double precision, which few grasps need and which takes four times as long."""
STEP = 0.01
"""Of log odds: grasps that are closer count as equally good."""
UNSURE = 2e-5
"""Bound of single precision's error, as a share of 1 + the size of a network's answer: 25 times
the largest error found, with the kernels of four kinds of processor (docs/reference/physics.md)."""
SYMMETRIES = ((False, False), (True, False), (False, True), (True, True))
"""Mirrorings, along x and y, over which the answer is averaged."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class GraspModel:
    """A trained network of one kind."""

    kind: str
    """One of ``KINDS``."""
    crop: CropShape
    touch: TouchWindow
    network: GraspNet
    """In evaluation mode."""
    slope: float = 1.0
    offset: float = 0.0
    """The logit is ``slope`` times the network's answer plus ``offset``: calibration, after Platt
    (1999)."""
    facts: Mapping[str, Any] = field(default_factory=dict)
    """How it was trained, as plain data."""
    sha256: str = ""
    """Of its file; empty when it was not loaded from one."""

    @property
    def uses(self) -> tuple[str, ...]:
        """Names of its inputs."""
        return KINDS[self.kind]

    def raw_logits(self, inputs: Inputs) -> Array:
        """Return the network's own answers (K,), averaged over the symmetries."""
        return _answers(self.network, {name: inputs[name] for name in self.uses}, CHUNK)

    def predict(self, inputs: Inputs) -> Array:
        """Return the probability (K,) that each grasp holds.

        Args:
            inputs: What it ``uses``; more is left alone.
        """
        logits = self.slope * self.raw_logits(inputs) + self.offset
        small = exp(-np.abs(logits))  # exp of the logits would overflow
        return np.asarray(np.where(logits < 0.0, small, 1.0) / (1.0 + small))

    def log_odds(self, inputs: Inputs) -> Array:
        """Return the logarithm of the odds (K,) that each grasp holds, in steps of ``STEP``.

        They are the same on all processors, whose kernels differ in the last bits: an answer so
        near the middle between two steps that single precision cannot tell which is nearer is
        worked out in double precision.
        """
        raw = self.raw_logits(inputs)
        odds = self.slope * raw + self.offset
        steps = odds / STEP
        from_middle = np.abs(np.abs(steps - np.rint(steps)) - 0.5) * STEP
        unsure = from_middle < abs(self.slope) * UNSURE * (1.0 + np.abs(raw))
        if unsure.any():
            used = {name: inputs[name][unsure] for name in self.uses}
            exact = _answers(copy.deepcopy(self.network).double(), used, EXACT_CHUNK)
            steps[unsure] = (self.slope * exact + self.offset) / STEP
        return np.rint(steps) * STEP + 0.0  # never -0.0, which is other bytes


def _answers(network: GraspNet, inputs: Inputs, size: int) -> Array:
    """Return a network's answers (K,), ``size`` grasps at a time."""
    import torch

    count = len(next(iter(inputs.values())))
    out = np.zeros(count)
    threads = torch.get_num_threads()
    torch.set_num_threads(1)  # sums of several threads differ in their last bits
    try:
        with torch.inference_mode():
            for start in range(0, count, size):
                chunk = take(inputs, slice(start, start + size))
                out[start : start + size] = _chunk(network, chunk, size)[: count - start]
    finally:
        torch.set_num_threads(threads)
    return out


def _chunk(network: GraspNet, inputs: Inputs, size: int) -> Array:
    import torch

    precision = next(network.parameters()).dtype
    full = {name: _padded(values, size) for name, values in inputs.items()}
    total = np.zeros(size)
    for x, y in SYMMETRIES:
        seen = mirrored(full, np.full(size, x), np.full(size, y))
        tensors = {
            name: torch.from_numpy(np.ascontiguousarray(values)).to(precision)
            for name, values in seen.items()
        }
        total += network(tensors).numpy().astype(np.float64)
    return total / len(SYMMETRIES)


def _padded(values: NDArray[np.float32], size: int) -> NDArray[np.float32]:
    missing = size - len(values)
    return np.concatenate([values, np.zeros((missing, *values.shape[1:]), np.float32)])
