"""TFRecord files of tf.train.Example messages, without TensorFlow.

A record is its length, a checksum of the length, the data and a checksum of the data:
https://www.tensorflow.org/tutorials/load_data/tfrecord#tfrecords_format_details. The messages are
https://github.com/tensorflow/tensorflow/blob/master/tensorflow/core/example/example.proto and
feature.proto beside it, in the encoding of https://protobuf.dev/programming-guides/encoding/.
"""

from __future__ import annotations

import struct
from collections.abc import Iterable, Iterator, Mapping
from typing import Any

import google_crc32c
from numpy.typing import NDArray

FeatureList = list[bytes] | NDArray[Any]
"""Values of a feature: byte strings, or numbers of any shape as int64 or float32."""
_BYTES_LIST, _FLOAT_LIST, _INT64_LIST = 1, 2, 3
"""Numbers of the fields of the message Feature."""
_LENGTH_DELIMITED = 2
"""Wire type of texts, messages and packed numbers."""
RECORD_BYTES = 16
"""Of a record, beside its data."""


def record(data: bytes) -> bytes:
    """Return data as one record of a TFRecord file."""
    length = struct.pack("<Q", len(data))
    return length + _checksum(length) + data + _checksum(data)


def example(features: Mapping[str, FeatureList]) -> bytes:
    """Return a message tf.train.Example; numbers that are not whole become float32."""
    entries = (
        _field(1, _field(1, name.encode()), _field(2, _feature(values)))
        for name, values in features.items()
    )
    return _field(1, *entries)


def _feature(values: FeatureList) -> bytes:
    if isinstance(values, list):
        return _field(_BYTES_LIST, *(_field(1, value) for value in values))
    if values.dtype.kind == "f":
        return _field(_FLOAT_LIST, _field(1, values.astype("<f4").tobytes()))
    return _field(_INT64_LIST, _field(1, *_varints(values.ravel().tolist())))


def _field(number: int, *parts: bytes) -> bytes:
    """Return a field of a message, whose content is in parts."""
    head = _varints([number << 3 | _LENGTH_DELIMITED, sum(map(len, parts))])
    return b"".join([*head, *parts])


def _varints(numbers: Iterable[int]) -> Iterator[bytes]:
    """Yield integers as varints: seven bits in a byte, the lowest first; -1 is 2**64 - 1."""
    for number in numbers:
        rest = number & (2**64 - 1)
        digits = bytearray()
        while rest > 0x7F:
            digits.append(rest & 0x7F | 0x80)
            rest >>= 7
        yield bytes([*digits, rest])


def _checksum(data: bytes) -> bytes:
    """Return the masked CRC-32C of a TFRecord file."""
    crc = google_crc32c.value(data)
    return struct.pack("<I", ((crc >> 15 | crc << 17) + 0xA282EAD8) & 0xFFFFFFFF)
