"""A trained network with what is needed to ask it: the probability that a grasp holds."""

# ruff: noqa: PLC0415

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from grasp_factory.crops import CropShape
from grasp_factory.geometry import Array
from grasp_factory.networks.inputs import KINDS, Inputs, TouchWindow, mirrored, take

if TYPE_CHECKING:
    from grasp_factory.networks.nets import GraspNet

CHUNK = 64
"""Grasps that go through the network together. Kernels are chosen by the shape, and with them the
last bits; so a chunk is always full, and a grasp's probability does not hang on the others."""
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
        """Names of the inputs that it looks at."""
        return KINDS[self.kind]

    def raw_logits(self, inputs: Inputs) -> Array:
        """Return the network's own answers (K,), averaged over the symmetries."""
        import torch

        used = {name: inputs[name] for name in self.uses}
        count = len(next(iter(used.values())))
        out = np.zeros(count)
        threads = torch.get_num_threads()
        torch.set_num_threads(1)  # sums of several threads differ in their last bits
        try:
            with torch.inference_mode():
                for start in range(0, count, CHUNK):
                    chunk = take(used, slice(start, start + CHUNK))
                    out[start : start + CHUNK] = self._chunk(chunk, min(CHUNK, count - start))
        finally:
            torch.set_num_threads(threads)
        return out

    def _chunk(self, inputs: Inputs, count: int) -> Array:
        import torch

        full = {name: _padded(values) for name, values in inputs.items()}
        total = np.zeros(CHUNK)
        for x, y in SYMMETRIES:
            seen = mirrored(full, np.full(CHUNK, x), np.full(CHUNK, y))
            tensors = {n: torch.from_numpy(np.ascontiguousarray(v)) for n, v in seen.items()}
            total += self.network(tensors).numpy().astype(np.float64)
        return np.asarray(total[:count] / len(SYMMETRIES))

    def predict(self, inputs: Inputs) -> Array:
        """Return the probability (K,) that each grasp holds.

        Args:
            inputs: What it ``uses``; more is left alone.
        """
        logits = self.slope * self.raw_logits(inputs) + self.offset
        return np.asarray(0.5 + 0.5 * np.tanh(0.5 * logits))  # exp would overflow


def _padded(values: NDArray[np.float32]) -> NDArray[np.float32]:
    missing = CHUNK - len(values)
    return np.concatenate([values, np.zeros((missing, *values.shape[1:]), np.float32)])
