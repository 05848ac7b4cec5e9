"""The networks: a trunk for each input, and a head over their features."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import torch
from torch import Tensor, nn

from grasp_factory.policies.networks.inputs import IMAGE, TOUCH, WIDTH

IMAGE_FEATURES, TOUCH_FEATURES, HIDDEN = 64, 32, 64
CHANNELS = (16, 32, 64)
"""Of the image's trunk, at a half, a quarter and an eighth of its size."""
DROPOUT = 0.3


class GraspNet(nn.Module):
    """One logit a grasp, from the inputs that are named.

    For 48 x 48 pixels 200,000 parameters with an image, 16,000 with touch alone.
    """

    def __init__(self, uses: Sequence[str], size: int) -> None:
        """Build it with random weights.

        Args:
            uses: Names of inputs.
            size: Pixels a side of images.
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
        """Return the logits (K,) of ``inputs``, named as in ``networks.inputs``."""
        found = [trunk(inputs[name]) for name, trunk in self.trunks.items()]
        if self.takes_width:
            found.append(inputs[WIDTH])
        logits: Tensor = self.head(torch.cat(found, dim=1))
        return logits[:, 0]


class _Residual(nn.Module):
    """Two convolutions around which the input also passes by (He et al., 2016)."""

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
    """Return (K, 3, S, S) to (K, 64); positions matter, so there is no average pooling."""
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
    """Return (K, 2, 6, R) to (K, 32)."""
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
