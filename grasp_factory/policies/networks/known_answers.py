"""A network of known weights: its answers show whether this machine's kernels are exact enough."""

# ruff: noqa: PLC0415

from __future__ import annotations

import numpy as np

from grasp_factory.core.geometry import Array
from grasp_factory.core.optional import require
from grasp_factory.policies.networks.inputs import IMAGE, KINDS, WIDTH, TouchWindow
from grasp_factory.policies.networks.model import CHUNK, GraspModel
from grasp_factory.signals.grasp_crop import CropShape

KIND = "vision"
SIDE = 16
"""Pixels."""
ROUNDS = 4
"""Chunks of grasps that it scores."""


def known_log_odds() -> Array:
    """Return the log odds of some made-up grasps, as rounded as a policy's.

    They are other numbers where kernels are less exact than single precision should be, and where a
    learned policy may therefore rank grasps otherwise.

    Raises:
        UsageError: if torch is not installed.
    """
    require("torch", "safetensors", extra="train")
    import torch

    from grasp_factory.policies.networks.nets import GraspNet

    rng = np.random.default_rng(20)
    network = GraspNet(KINDS[KIND], SIDE).eval()
    with torch.no_grad():
        for name, weights in network.named_parameters():
            reach = 1.0 if weights.ndim == 1 else 3.0 / float(np.sqrt(weights[0].numel()))
            values = rng.uniform(-reach, reach, tuple(weights.shape))
            if name.endswith("weight") and weights.ndim == 1:
                values = 1.0 + 0.1 * values  # of normalisation
            weights.copy_(torch.from_numpy(values.astype(np.float32)))
    count = ROUNDS * CHUNK
    inputs = {
        IMAGE: rng.uniform(-1.0, 1.0, (count, 3, SIDE, SIDE)).astype(np.float32),
        WIDTH: rng.uniform(0.0, 1.0, (count, 1)).astype(np.float32),
    }
    model = GraspModel(kind=KIND, crop=CropShape(size=SIDE), touch=TouchWindow(), network=network)
    return model.log_odds(inputs)
