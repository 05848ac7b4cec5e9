"""Types of messages for Cyclone DDS, made from the definitions of ROS 2 Humble.

A sample holds the bytes of a message as they are sent (CDR with its header), so that a message is
neither decoded nor changed on its way. https://cyclonedds.io/docs/cyclonedds-python/
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache
from typing import Any

from cyclonedds.idl import IdlStruct, make_idl_struct
from cyclonedds.idl import types as idl
from rosbags.interfaces import Nodetype

from grasp_factory.capture.ros2.dds_names import dds_type
from grasp_factory.errors import GraspFactoryError, UsageError, lookup
from grasp_factory.writers.exporters.rosbag.bag_files import ros2_types

_NUMBERS = ("int8", "int16", "int32", "int64", "uint8", "uint16", "uint32", "uint64")
_BASE: Mapping[str, Any] = {
    **{name: getattr(idl, name) for name in (*_NUMBERS, "float32", "float64")},
    **dict.fromkeys(("byte", "char", "octet"), idl.uint8),
    "bool": bool,
    "string": str,
}


def check_type(kind: str) -> None:
    """Check that a type of messages is one of ROS 2 Humble.

    Raises:
        UnknownNameError: naming the nearest one.
    """
    if kind not in ros2_types().fielddefs:
        raise _unknown(kind)


def knows_type(kind: str) -> bool:
    """Return whether a type of messages is one of ROS 2 Humble."""
    return kind in ros2_types().fielddefs


def sample_of(sample_type: type[IdlStruct], data: bytes) -> Any:
    """Return a sample with the bytes of a message."""
    sample = object.__new__(sample_type)
    sample.cdr = data
    return sample


@cache
def sample_type_of(kind: str) -> type[IdlStruct]:
    """Return the class of samples with messages of a type.

    All three methods that Cyclone DDS calls take the bytes as they are: it calls
    ``deserialize_key`` when a writer leaves.

    Raises:
        UnknownNameError: if ROS 2 Humble has no such type.
    """
    check_type(kind)
    made: Any = _struct(kind)
    made.serialize = _bytes_of
    made.deserialize = classmethod(_sample_from)
    made.deserialize_key = classmethod(_sample_from)
    found: type[IdlStruct] = made
    return found


def type_hash(kind: str) -> str:
    """Return the hash of a type's definition, REP 2016: ``RIHS01_...``."""
    return ros2_types().hash_rihs01(kind)


def _bytes_of(sample: Any, *_: Any, **__: Any) -> bytes:
    data: bytes = sample.cdr
    return data


def _sample_from(sample_type: type[IdlStruct], data: bytes, *_: Any, **__: Any) -> Any:
    return sample_of(sample_type, data)


@cache
def _struct(kind: str) -> type[IdlStruct]:
    """Return the structure of a type; a field's name has an underscore at its end, as in ROS."""
    _, fields = ros2_types().fielddefs[kind]
    name = dds_type(kind).replace("::", ".")
    made: type[IdlStruct] = make_idl_struct(
        name.rpartition(".")[2],
        name,
        {f"{field}_": _field(of) for field, of in fields},
        dataclassify=False,
    )
    return made


def _field(of: Any) -> Any:
    node, detail = of
    if node is Nodetype.NAME:
        return _struct(detail)
    if node is Nodetype.BASE:
        name, limit = detail
        return idl.bounded_str[limit] if limit else _BASE[name]
    inner, count = detail
    if node is Nodetype.ARRAY:
        return idl.array[_field(inner), count]
    return idl.sequence[_field(inner), count] if count else idl.sequence[_field(inner)]


def _unknown(kind: str) -> UsageError:
    try:
        lookup(ros2_types().fielddefs, "type of messages", kind)
    except UsageError as error:
        text, _, _ = str(error).partition(" (valid")
        return UsageError(f"{text}, valid: the types of ROS 2 Humble")
    raise AssertionError(kind)


def decoded(kind: str, data: bytes) -> Any:
    """Return a message.

    Raises:
        ValueError: if its bytes do not fit its type.
    """
    try:
        return ros2_types().deserialize_cdr(data, kind)
    except (MemoryError, GraspFactoryError):
        raise
    except Exception as error:
        raise ValueError(f"the bytes are no {kind}: {error}") from None
