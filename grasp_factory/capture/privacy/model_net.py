"""Neural networks from ONNX files, run by OpenCV.

OpenCV is a dependency already. onnxruntime refuses the face model at any other size than the one
in its file (10 x 3 x 32 x 32), unless the file is rewritten first; OpenCV takes any size.
"""

from __future__ import annotations

import hashlib
import os
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from grasp_factory.core.limits import MODEL
from grasp_factory.core.regular_file import open_regular, read_part
from grasp_factory.errors import CaptureError, IrregularFileError, UsageError, shown

_MOST_NETS = 8
"""Image sizes of which the nets are kept."""


class ModelNet:
    """A network of an ONNX file that was read once.

    There is one net for each size of image: a net of OpenCV 4.12 and 4.13 that sees a second size
    finds hundreds of things that are not there.
    """

    def __init__(self, path: Path) -> None:
        """Read the file.

        Raises:
            UsageError: if it cannot be read, or is no ONNX file that OpenCV can use.
            LimitError: if it is too large.
        """
        cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_SILENT)  # errors are raised
        self.path = path
        self.content = _content(path)
        self.sha256 = hashlib.sha256(self.content).hexdigest()
        self._first: cv2.dnn.Net | None = self._new_net()
        self._nets: dict[tuple[int, ...], cv2.dnn.Net] = {}

    def outputs(
        self, blob: NDArray[np.float32], names: tuple[str, ...]
    ) -> list[NDArray[np.float32]]:
        """Return the outputs of some names, or of all for no names, for an input (1, 3, H, W).

        Raises:
            CaptureError: if the network cannot take the input.
        """
        if blob.shape not in self._nets:
            if len(self._nets) >= _MOST_NETS:
                self._nets.clear()
            self._nets[blob.shape] = self._first or self._new_net()
            self._first = None
        net = self._nets[blob.shape]
        try:
            net.setInput(blob)
            found = net.forward(list(names or net.getUnconnectedOutLayersNames()))
        except cv2.error as error:
            size = " x ".join(map(str, blob.shape))
            raise CaptureError(
                f"{self.path}: the model cannot take an input of {size}: {shown(error.err)}"
            ) from None
        return [np.asarray(values, np.float32) for values in found]

    def _new_net(self) -> cv2.dnn.Net:
        try:
            net = cv2.dnn.readNetFromONNX(np.frombuffer(self.content, np.uint8))
        except cv2.error as error:
            raise UsageError(
                f"{self.path} is no ONNX file that OpenCV can read: {shown(error.err)}"
            ) from None
        if net.empty():
            raise UsageError(f"{self.path} is no ONNX file that OpenCV can read: it is empty")
        return net


def _content(path: Path) -> bytes:
    try:
        descriptor = open_regular(path, os.O_RDONLY)
    except IrregularFileError:
        raise UsageError(
            f"{path} is a link or no regular file: name the ONNX file itself"
        ) from None
    except OSError as error:
        raise UsageError(f"{path} cannot be read: {error.strerror or error}") from None
    try:
        size = os.fstat(descriptor).st_size
        MODEL.check(size, path)
        return read_part(descriptor, size)
    finally:
        os.close(descriptor)
