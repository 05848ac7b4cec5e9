"""Files of small untrained models: as good as any for everything but grasping."""

from __future__ import annotations

from functools import cache

from grasp_factory.policies.networks import KINDS, GraspModel, TouchWindow, save_model
from grasp_factory.signals.grasp_crop import CropShape


@cache
def tiny_model(seed: int, kind: str = "vision") -> bytes:
    """Return a model with weights drawn from a seed; that of seed 0 thinks the same of all."""
    import torch

    from grasp_factory.policies.networks.nets import GraspNet

    crop = CropShape(size=8)
    with torch.random.fork_rng():
        torch.manual_seed(seed)
        network = GraspNet(KINDS[kind], crop.size).eval()
    if seed == 0:
        with torch.no_grad():
            for weights in network.parameters():
                weights.zero_()
    model = GraspModel(kind=kind, crop=crop, touch=TouchWindow(), network=network, slope=20.0)
    return save_model(model)
