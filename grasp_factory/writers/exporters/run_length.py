"""COCO's run-length encoding of masks.

The runs of a mask are counted column by column, first those of zeros; the text has the differences
of the counts, each in groups of 5 bits. Definition: ``rleEncode`` and ``rleToString`` in
https://github.com/cocodataset/cocoapi/blob/master/common/maskApi.c
"""

from __future__ import annotations

from itertools import chain
from typing import Any

import numpy as np
from numpy.typing import NDArray


def run_length(mask: NDArray[np.bool_]) -> dict[str, Any]:
    """Return a mask (H, W) as COCO's ``segmentation``: ``size`` [H, W] and ``counts``, a text."""
    pixels = mask.ravel(order="F")
    changes = np.flatnonzero(pixels[1:] != pixels[:-1]) + 1
    start = [0, 0] if pixels[0] else [0]
    counts = np.diff([*start, *changes.tolist(), pixels.size]).tolist()
    before = chain([0, 0, 0], counts[1:])
    text = "".join(_text(n - past) for n, past in zip(counts, before, strict=False))
    return {"size": list(mask.shape), "counts": text}


def _text(number: int) -> str:
    """Return a whole number as text: 5 bits a character, the lowest first, and one bit for more."""
    text = ""
    while True:
        low, number = number & 31, number >> 5
        is_last = number == (-1 if low & 16 else 0)
        text += chr(low + (0 if is_last else 32) + 48)
        if is_last:
            return text
