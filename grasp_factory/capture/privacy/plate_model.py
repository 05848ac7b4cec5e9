"""Licence plates by the user's own model.

The ONNX file has one input, RGB (1, 3, H, W) float32 from 0 to 1, into which the image is fitted
with grey borders (640 x 640 pixels if the file leaves the size open). It has one output, with boxes
in pixels of the input, as those that Ultralytics' YOLO exports write
(https://docs.ultralytics.com/modes/export/):

- (1, 4 + C, N): centre x and y, width and height, and the scores of C classes, for N places,
- or (1, N, 6): left, top, right, bottom, score and class.

All classes count as plates.
"""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from grasp_factory.capture.privacy.detections import Detections, strongest
from grasp_factory.capture.privacy.model_net import ModelNet
from grasp_factory.capture.privacy.onnx_input import input_shapes
from grasp_factory.core.geometry import Array
from grasp_factory.core.text_format import escaped
from grasp_factory.errors import CaptureError, shown

_GREY = 114
"""Of the borders, as in training of YOLO."""
_MOST_PLACES = 1_000_000
_OPEN_SIDE = 640
"""Pixels of an input whose size the file leaves open, that of YOLO's own training."""
_LONGEST_SIDE = 4096


class PlateDetector:
    """Finds licence plates."""

    what = "plate"

    def __init__(self, path: Path, threshold: float) -> None:
        """Read the model, and try it on a grey image.

        Args:
            path: the ONNX file.
            threshold: the least score of a plate.

        Raises:
            UsageError: if it is no ONNX file.
            CaptureError: if its input or output is another one.
        """
        self._net = ModelNet(path)
        self._height, self._width = _size(self._net)
        self.model, self.sha256 = escaped(path.name), self._net.sha256
        self.threshold = threshold
        self.find(np.full((self._height, self._width, 3), _GREY, np.uint8))

    def find(self, rgb: NDArray[np.uint8]) -> Detections:
        """See ``Detector.find``."""
        scale = min(self._height / rgb.shape[0], self._width / rgb.shape[1])
        size = [max(1, round(side * scale)) for side in rgb.shape[1::-1]]
        fitted = np.full((self._height, self._width, 3), _GREY, np.uint8)
        fitted[: size[1], : size[0]] = cv2.resize(rgb, size, interpolation=cv2.INTER_LINEAR)
        outputs = self._net.outputs(np.asarray(cv2.dnn.blobFromImage(fitted, 1.0 / 255.0)), ())
        if len(outputs) != 1:
            raise CaptureError(f"{self._net.path}: the model has {len(outputs)} outputs, valid: 1")
        try:
            boxes, scores = decode_boxes(outputs[0])
        except ValueError as error:
            raise CaptureError(f"{self._net.path}: {error}") from None
        return strongest(boxes / scale, scores, self.threshold)


def decode_boxes(output: NDArray[np.float32]) -> tuple[Array, Array]:
    """Return boxes (N, 4) and scores (N,) from a model's output.

    Raises:
        ValueError: if it has neither of the two shapes.
    """
    shape = output.shape
    is_batch = len(shape) == 3 and shape[0] == 1
    if not is_batch or max(shape) > _MOST_PLACES or not np.isfinite(output).all():
        raise ValueError(_shape_text(shape))
    values = output[0].astype(np.float64)
    if shape[2] == 6 and shape[1] != 6:
        return values[:, :4], values[:, 4]
    if 5 <= shape[1] < shape[2]:
        centre, half = values[:2].T, values[2:4].T / 2
        return np.concatenate([centre - half, centre + half], axis=1), values[4:].max(axis=0)
    raise ValueError(_shape_text(shape))


def _size(net: ModelNet) -> tuple[int, int]:
    """Return height and width of a model's input."""
    try:
        shapes = input_shapes(net.content)
    except ValueError as error:
        raise CaptureError(f"{net.path}: its input cannot be read: {error}") from None
    fits = len(shapes) == 1 and len(shapes[0]) == 4 and shapes[0][0] in (0, 1)
    sides = [side or _OPEN_SIDE for side in shapes[0][2:]] if fits else []
    if not sides or shapes[0][1] not in (0, 3) or max(sides) > _LONGEST_SIDE:
        raise CaptureError(
            f"{net.path}: the model's inputs have the shapes {shown(shapes)}, valid: one of"
            f" (1, 3, height, width) with up to {_LONGEST_SIDE} pixels"
        )
    return sides[0], sides[1]


def _shape_text(shape: tuple[int, ...]) -> str:
    return (
        f"the model's output has the shape {shape}, valid: (1, 4 + classes, places) with more"
        " places than rows, or (1, places, 6), of finite numbers"
    )
