"""Small networks that predict whether a grasp will hold: their inputs, weights and predictions.

A new kind of input is a function in ``inputs.py`` and a trunk in ``nets.py``; a new network that
looks at other inputs is one row of ``KINDS``. Importing this package does not import torch.
"""

from __future__ import annotations

from grasp_factory.policies.networks.inputs import (
    KINDS,
    TOUCH,
    WIDTH,
    Inputs,
    TouchWindow,
    grasp_inputs,
    image_of,
    mirrored,
    take,
    touch_of,
    width_of,
)
from grasp_factory.policies.networks.loading import load_model, save_model
from grasp_factory.policies.networks.model import GraspModel

__all__ = [
    "KINDS",
    "TOUCH",
    "WIDTH",
    "GraspModel",
    "Inputs",
    "TouchWindow",
    "grasp_inputs",
    "image_of",
    "load_model",
    "mirrored",
    "save_model",
    "take",
    "touch_of",
    "width_of",
]
