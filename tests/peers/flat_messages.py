"""ROS messages as arrays, from the objects of any library: one array for each field of a topic.

It needs NumPy alone: the readers of the peers import it, too.
"""

from collections.abc import Iterable, Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

_ROS1_NAMES = {"secs": "sec", "nsecs": "nanosec"}
"""Fields of a time in genpy."""


def flat_arrays(messages: Iterable[tuple[str, int, Any]]) -> dict[str, NDArray[Any]]:
    """Return arrays (messages, ...) by ``TOPIC|FIELD`` from topic, stamp (ns) and message.

    A field of a field is joined by a dot, an element of a list of messages is its position. The
    stamp at which a message was sent is ``TOPIC|sent_ns``.
    """
    found: dict[str, list[Any]] = {}
    for topic, sent_ns, message in messages:
        found.setdefault(f"{topic}|sent_ns", []).append(sent_ns)
        for name, value in flat(message):
            found.setdefault(f"{topic}|{name}", []).append(value)
    return {key: np.array(values) for key, values in found.items()}


def flat(message: Any, name: str = "") -> Iterator[tuple[str, Any]]:
    """Yield name and value of all fields of a message."""
    if slots := slots_of(message):
        for slot in slots:
            plain = _ROS1_NAMES.get(slot, slot.lower())
            yield from flat(getattr(message, slot), f"{name}.{plain}" if name else plain)
    elif isinstance(message, bytes | bytearray):
        yield name, np.frombuffer(message, np.uint8)
    elif isinstance(message, list | tuple) and any(map(slots_of, message)):
        for k, item in enumerate(message):
            yield from flat(item, f"{name}.{k}")
    else:
        yield name, message


def slots_of(message: Any) -> list[str]:
    """Return the names of a message's fields; none for what is no message.

    The classes of rosbags list ``__msgtype__`` and constants, such as ``TEXT_VIEW_FACING``, too.
    """
    if hasattr(message, "get_fields_and_field_types"):  # rclpy
        return list(message.get_fields_and_field_types())
    found = getattr(message, "__dataclass_fields__", None) or getattr(message, "__slots__", ())
    return [name for name in found if len(name) == 1 or not (name.isupper() or name[0] == "_")]
