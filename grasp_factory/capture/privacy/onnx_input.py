"""The shape of a model's input, read from the ONNX file itself: OpenCV does not check it.

Only the few fields that lead to it are read; numbers and names of the fields are those of
https://github.com/onnx/onnx/blob/main/onnx/onnx.proto, the encoding that of
https://protobuf.dev/programming-guides/encoding/
"""

from __future__ import annotations

from collections.abc import Iterator

_GRAPH = 7
"""Of ModelProto."""
_INITIALIZER, _INPUT = 5, 11
"""Of GraphProto."""
_TENSOR_NAME = 8
"""Of TensorProto."""
_VALUE_NAME, _VALUE_TYPE = 1, 2
"""Of ValueInfoProto."""
_TENSOR_TYPE, _SHAPE, _DIMENSION, _SIZE = 1, 2, 1, 1
"""Of TypeProto, its tensor, TensorShapeProto and its dimension."""
_VARINT, _FIXED64, _BYTES, _FIXED32 = 0, 1, 2, 5
_LONGEST_VARINT = 10
"""Bytes."""


def input_shapes(content: bytes) -> list[tuple[int, ...]]:
    """Return the shape of each input of a model; 0 stands for a size that is open.

    Raises:
        ValueError: if it is no ONNX file.
    """
    graphs = list(_parts(memoryview(content), _GRAPH))
    if len(graphs) != 1:
        raise ValueError(f"an ONNX file has 1 graph, got {len(graphs)}")
    constants = {
        bytes(name)
        for tensor in _parts(graphs[0], _INITIALIZER)
        for name in _parts(tensor, _TENSOR_NAME)
    }
    return [
        _shape(value)
        for value in _parts(graphs[0], _INPUT)
        if not constants & {bytes(name) for name in _parts(value, _VALUE_NAME)}
    ]


def _shape(value: memoryview) -> tuple[int, ...]:
    return tuple(
        next((n for number, n in _fields(dimension) if number == _SIZE and isinstance(n, int)), 0)
        for kind in _parts(value, _VALUE_TYPE)
        for tensor in _parts(kind, _TENSOR_TYPE)
        for shape in _parts(tensor, _SHAPE)
        for dimension in _parts(shape, _DIMENSION)
    )


def _parts(message: memoryview, wanted: int) -> Iterator[memoryview]:
    """Yield the fields of a number that have bytes."""
    for number, value in _fields(message):
        if number == wanted and isinstance(value, memoryview):
            yield value


def _fields(message: memoryview) -> Iterator[tuple[int, int | memoryview]]:
    """Yield number and value of each field of a message."""
    at = 0
    while at < len(message):
        key, at = _varint(message, at)
        kind = key & 7
        if kind == _VARINT:
            value, at = _varint(message, at)
            yield key >> 3, value
            continue
        if kind == _BYTES:
            size, at = _varint(message, at)
        elif kind in (_FIXED64, _FIXED32):
            size = 8 if kind == _FIXED64 else 4
        else:
            raise ValueError(f"a field of the kind {kind}")
        if size > len(message) - at:
            raise ValueError("a field that is longer than the file")
        yield key >> 3, message[at : at + size]
        at += size


def _varint(message: memoryview, at: int) -> tuple[int, int]:
    """Return a number, and where the next byte is."""
    value = 0
    for k, byte in enumerate(message[at : at + _LONGEST_VARINT]):
        value |= (byte & 127) << 7 * k
        if byte < 128:
            return value, at + k + 1
    raise ValueError("a number without an end")
