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
"""Number of grasps that the network evaluates together.

The kernels, and with them the last bits, depend on the shape. So a chunk is always filled up to
this size, and the probability of a grasp does not depend on the other grasps.
"""
EXACT_CHUNK = 4
"""The same in double precision, which few grasps need; it takes four times as long."""
STEP = 0.01
"""Log odds are rounded to multiples of this; grasps with equal results count as equally good."""
UNSURE = 2e-5
"""Bound for the error of single precision, divided by 1 + the absolute output of the network.

It is 25 times the largest error found with the kernels of four kinds of processor
(docs/reference/physics.md).
"""
SYMMETRIES = ((False, False), (True, False), (False, True), (True, True))
"""Reflections along (x, y) over which the output is averaged."""


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
    """The logit is ``slope`` times the network's output plus ``offset`` (after Platt, 1999)."""
    facts: Mapping[str, Any] = field(default_factory=dict)
    """Facts about the training, as plain data."""
    sha256: str = ""
    """SHA-256 of the model's file; empty if it was not loaded from a file."""

    @property
    def uses(self) -> tuple[str, ...]:
        """Names of the network's inputs."""
        return KINDS[self.kind]

    def raw_logits(self, inputs: Inputs) -> Array:
        """Return the network's outputs (K,) before calibration, averaged over the symmetries."""
        return _answers(self.network, {name: inputs[name] for name in self.uses}, CHUNK)

    def predict(self, inputs: Inputs) -> Array:
        """Return the probability (K,) that each grasp holds.

        Args:
            inputs: The inputs that it ``uses``; others are ignored.
        """
        logits = self.slope * self.raw_logits(inputs) + self.offset
        small = exp(-np.abs(logits))  # exp of the logits would overflow
        return np.asarray(np.where(logits < 0.0, small, 1.0) / (1.0 + small))

    def log_odds(self, inputs: Inputs) -> Array:
        """Return the logarithm of the odds (K,) that each grasp holds, in steps of ``STEP``.

        They are the same on all processors, although kernels differ in the last bits: an output so
        close to the middle between two steps that the error of single precision could change the
        rounding is computed again in double precision.
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
        return np.rint(steps) * STEP + 0.0  # + 0.0 because -0.0 has different bytes


def _answers(network: GraspNet, inputs: Inputs, size: int) -> Array:
    """Return a network's outputs (K,), computed for ``size`` grasps at a time."""
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
