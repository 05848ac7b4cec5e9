"""The architecture of the networks: a trunk for each input, and a head on their features."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import torch
from torch import Tensor, nn

from grasp_factory.policies.networks.inputs import IMAGE, TOUCH, WIDTH

IMAGE_FEATURES, TOUCH_FEATURES, HIDDEN = 64, 32, 64
CHANNELS = (16, 32, 64)
"""Channels of the image trunk at 1/2, 1/4 and 1/8 of the image's size."""
DROPOUT = 0.3


class GraspNet(nn.Module):
    """A network that returns one logit for each grasp, from the given inputs.

    It has 200,000 parameters with images of 48 x 48 pixels, 16,000 with touch only.
    """

    def __init__(self, uses: Sequence[str], size: int) -> None:
        """Initialise the network with random weights.

        Args:
            uses: Names of the inputs.
            size: Width and height of the images, pixels.
        """
        super().__init__()
        trunks: dict[str, nn.Module] = {}
        features = 0
        if IMAGE in uses:
            trunks[IMAGE], features = _image_trunk(size), features + IMAGE_FEATURES
        if TOUCH in uses:
            trunks[TOUCH], features = _touch_trunk(), features + TOUCH_FEATURES
        self.trunks = nn.ModuleDict(trunks)
        self.takes_width = WIDTH in uses
        self.head = nn.Sequential(
            nn.Linear(features + self.takes_width, HIDDEN),
            nn.ReLU(),
            nn.Dropout(DROPOUT),
            nn.Linear(HIDDEN, 1),
        )

    def forward(self, inputs: Mapping[str, Tensor]) -> Tensor:
        """Return the logits (K,) for ``inputs``; the names are those in ``networks.inputs``."""
        found = [trunk(inputs[name]) for name, trunk in self.trunks.items()]
        if self.takes_width:
            found.append(inputs[WIDTH])
        logits: Tensor = self.head(torch.cat(found, dim=1))
        return logits[:, 0]


class _Residual(nn.Module):
    """A residual block: the input is added to the result of two convolutions (He et al., 2016)."""

    def __init__(self, channels: int) -> None:
        super().__init__()
        self.inner = nn.Sequential(
            *_convolution(channels, channels),
            nn.Conv2d(channels, channels, 3, padding=1, bias=False),
            nn.BatchNorm2d(channels),
        )

    def forward(self, x: Tensor) -> Tensor:
        return torch.relu(x + self.inner(x))


def _convolution(ins: int, outs: int, kernel: int = 3, stride: int = 1) -> Sequence[nn.Module]:
    conv = nn.Conv2d(ins, outs, kernel, stride=stride, padding=kernel // 2, bias=False)
    return conv, nn.BatchNorm2d(outs), nn.ReLU()


def _image_trunk(size: int) -> nn.Module:
    """Return a module from (K, 3, S, S) to (K, 64); positions matter, so it has no mean pooling."""
    side = -(-size // 8)
    first, second, third = CHANNELS
    return nn.Sequential(
        *_convolution(3, first, kernel=5, stride=2),
        _Residual(first),
        *_convolution(first, second, stride=2),
        _Residual(second),
        *_convolution(second, third, stride=2),
        nn.Flatten(),
        nn.Linear(third * side * side, IMAGE_FEATURES),
        nn.ReLU(),
    )


def _touch_trunk() -> nn.Module:
    """Return a module from (K, 2, 6, R) to (K, 32)."""
    return nn.Sequential(
        nn.Flatten(1, 2),
        nn.Conv1d(12, TOUCH_FEATURES, 5, stride=2, padding=2),
        nn.ReLU(),
        nn.Conv1d(TOUCH_FEATURES, TOUCH_FEATURES, 5, stride=2, padding=2),
        nn.ReLU(),
        nn.Conv1d(TOUCH_FEATURES, TOUCH_FEATURES, 3, stride=2, padding=1),
        nn.ReLU(),
        nn.AdaptiveAvgPool1d(4),
        nn.Flatten(),
        nn.Linear(4 * TOUCH_FEATURES, TOUCH_FEATURES),
        nn.ReLU(),
    )
