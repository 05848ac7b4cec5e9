"""A network with fixed weights, to test whether this machine's kernels are accurate enough."""

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
"""Width and height of the images, pixels."""
ROUNDS = 4
"""Number of chunks of grasps that the network scores."""


def known_log_odds() -> Array:
    """Return the log odds of made-up grasps, rounded like those of a learned policy.

    The numbers differ on machines whose kernels are less accurate than single precision should be.
    On such machines a learned policy may rank grasps differently.

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
                values = 1.0 + 0.1 * values  # weights of normalisation layers are close to 1
            weights.copy_(torch.from_numpy(values.astype(np.float32)))
    count = ROUNDS * CHUNK
    inputs = {
        IMAGE: rng.uniform(-1.0, 1.0, (count, 3, SIDE, SIDE)).astype(np.float32),
        WIDTH: rng.uniform(0.0, 1.0, (count, 1)).astype(np.float32),
    }
    model = GraspModel(kind=KIND, crop=CropShape(size=SIDE), touch=TouchWindow(), network=network)
    return model.log_odds(inputs)
