"""Small ONNX files that find white squares, written without a library.

https://github.com/onnx/onnx/blob/main/onnx/onnx.proto
"""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

CELL = 8
"""Pixels of a square."""
_FLOAT, _INT64, _INTS = 1, 7, 7


def square_finder(path: Path, side: int, kind: str = "yolo") -> Path:
    """Write a model that finds the squares of a grid of 8 x 8 pixels that are white.

    Args:
        path: the file.
        side: width and height of the input.
        kind: ``yolo``: output (1, 5, N); ``end_to_end``: (1, N, 6); ``map``: (1, 5, n, n), which
            is no list of boxes.
    """
    n, rows = side // CELL, 6 if kind == "end_to_end" else 5
    weights = np.zeros((rows, 3, CELL, CELL), np.float32)
    weights[4] = 10.0 / (3 * CELL * CELL)  # white is 1, up to nine tenths of white 0
    bias = np.zeros(rows, np.float32)
    bias[4] = -9.0
    shape = (1, 5, n, n) if kind == "map" else (1, rows, n * n)
    nodes = [
        _node("Conv", ["images", "weights", "bias"], "found", kernel_shape=[CELL] * 2,
              strides=[CELL] * 2),
        _node("Add", ["found", "places"], "placed"),
        _node("Reshape", ["placed", "shape"], "boxes"),
    ]  # fmt: skip
    output, out_shape = "boxes", shape
    if kind == "end_to_end":
        nodes.append(_node("Transpose", ["boxes"], "turned", perm=[0, 2, 1]))
        output, out_shape = "turned", (1, n * n, rows)
    tensors = [
        _tensor("weights", weights),
        _tensor("bias", bias),
        _tensor("places", _places(n, rows)),
        _tensor("shape", np.array(shape, np.int64)),
    ]
    graph = b"".join(
        [
            *(_field(1, node) for node in nodes),
            _field(2, b"squares"),
            *(_field(5, tensor) for tensor in tensors),
            _field(11, _value("images", (1, 3, side, side))),
            _field(12, _value(output, out_shape)),
        ]
    )
    opset = _field(1, b"") + _number(2, 13)
    path.write_bytes(_number(1, 8) + _field(8, opset) + _field(7, graph))
    return path


def _places(n: int, rows: int) -> NDArray[np.float32]:
    """Return centre, or left and top, and size, or right and bottom, of each cell."""
    out = np.zeros((1, rows, n, n), np.float32)
    y, x = np.mgrid[:n, :n] * CELL
    if rows == 6:
        out[0, :4] = np.stack([x, y, x + CELL, y + CELL])
    else:
        half = np.full((n, n), CELL)
        out[0, :4] = np.stack([x + CELL / 2, y + CELL / 2, half, half])
    return out


def _node(kind: str, inputs: Iterable[str], output: str, **attributes: list[int]) -> bytes:
    parts = [_field(1, name.encode()) for name in inputs]
    parts += [_field(2, output.encode()), _field(3, output.encode()), _field(4, kind.encode())]
    for name, values in attributes.items():
        numbers = b"".join(_number(8, value) for value in values)
        parts.append(_field(5, _field(1, name.encode()) + numbers + _number(20, _INTS)))
    return b"".join(parts)


def _tensor(name: str, values: NDArray[np.float32] | NDArray[np.int64]) -> bytes:
    kind = _INT64 if values.dtype == np.int64 else _FLOAT
    dims = b"".join(_number(1, size) for size in values.shape)
    return dims + _number(2, kind) + _field(8, name.encode()) + _field(9, values.tobytes())


def _value(name: str, shape: tuple[int, ...]) -> bytes:
    dims = b"".join(_field(1, _number(1, size)) for size in shape)
    tensor = _number(1, _FLOAT) + _field(2, dims)
    return _field(1, name.encode()) + _field(2, _field(1, tensor))


def _varint(value: int) -> bytes:
    out = bytearray()
    while value > 127:
        out.append(value & 127 | 128)
        value >>= 7
    return bytes([*out, value])


def _number(field: int, value: int) -> bytes:
    return _varint(field << 3) + _varint(value)


def _field(field: int, content: bytes) -> bytes:
    return _varint(field << 3 | 2) + _varint(len(content)) + content
