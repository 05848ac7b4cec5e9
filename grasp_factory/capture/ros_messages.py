"""Messages of sessions, from and to bytes (CDR), with the definitions of ROS 2 Humble.

https://ternaris.gitlab.io/rosbags/
"""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore

from grasp_factory.capture.session_reader import SessionMessage, SessionTopic
from grasp_factory.errors import CaptureError, GraspFactoryError, shown

IMAGE, COMPRESSED_IMAGE = "sensor_msgs/msg/Image", "sensor_msgs/msg/CompressedImage"
IMU, TEMPERATURE = "sensor_msgs/msg/Imu", "sensor_msgs/msg/Temperature"
WRENCH, JOINT_STATE = "geometry_msgs/msg/WrenchStamped", "sensor_msgs/msg/JointState"
STRING = "std_msgs/msg/String"
_CHANNELS = {"rgb8": 3, "bgr8": 3, "mono8": 1, "16UC1": 2, "32FC1": 4}
"""Bytes of a pixel by encoding."""
_MAX_SIDE = 16384


@cache
def humble() -> Typestore:
    """Return the messages of ROS 2 Humble."""
    return get_typestore(Stores.ROS2_HUMBLE)


@cache
def definition_of(message_type: str) -> str:
    """Return the text of a message's definition, as an MCAP file has it."""
    return humble().generate_msgdef(message_type, ros_version=2)[0]


def decoded(message: SessionMessage) -> Any:
    """Return a message's record.

    Raises:
        CaptureError: if its bytes, or the definition in the file, do not fit its type.
    """
    topic = message.topic
    _check_definition(topic)
    try:
        return humble().deserialize_cdr(message.data, topic.message_type)
    except (MemoryError, GraspFactoryError):
        raise
    except Exception as error:
        why = f"{type(error).__name__}: {error}"
        raise CaptureError(
            f"a message of {shown(topic.name)} is no {topic.message_type} ({shown(why)})"
        ) from None


def encoded(record: Any, message_type: str) -> bytes:
    """Return the bytes of a message."""
    return bytes(humble().serialize_cdr(record, message_type, little_endian=True))


def image_rows(image: Any, name: str) -> NDArray[np.uint8]:
    """Return the bytes of an image message's pixels (H, W, bytes of a pixel), a new array.

    Args:
        image: a sensor_msgs/Image.
        name: the topic, for messages.

    Raises:
        CaptureError: if the encoding is unknown, or its sizes do not fit its data.
    """
    depth = _CHANNELS.get(image.encoding)
    if depth is None:
        raise CaptureError(
            f"an image of {shown(name)} has the encoding {shown(image.encoding)}, valid:"
            f" {', '.join(_CHANNELS)}"
        )
    height, width, step = int(image.height), int(image.width), int(image.step)
    data = np.asarray(image.data, np.uint8)
    fits = 0 < width <= _MAX_SIDE and 0 < height <= _MAX_SIDE and step >= width * depth
    if not fits or data.size != height * step:
        raise CaptureError(
            f"an image of {shown(name)} has {data.size} bytes for {width} x {height} pixels with"
            f" rows of {step} bytes"
        )
    return data.reshape(height, step)[:, : width * depth].reshape(height, width, depth).copy()


def with_rows(image: Any, rows: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Return the data of an image message with other pixels; see ``image_rows``."""
    height, width, depth = rows.shape
    data = np.array(image.data, np.uint8).reshape(height, int(image.step))
    data[:, : width * depth] = rows.reshape(height, width * depth)
    return data.ravel()


@cache
def _check_definition(topic: SessionTopic) -> None:
    """Raise CaptureError if the file means by a type something else than ROS does."""
    name, kind = shown(topic.name), topic.message_type
    if topic.encoding != "cdr" or kind not in humble().fielddefs:
        raise CaptureError(
            f"{name} has messages of {shown(kind)} as {shown(topic.encoding)}, valid: messages of"
            " ROS 2 Humble as 'cdr'"
        )
    try:
        own = get_typestore(Stores.EMPTY)
        own.register(get_types_from_msg(topic.definition, kind))
        is_standard = own.hash_rihs01(kind) == humble().hash_rihs01(kind)
    except MemoryError:
        raise
    except Exception:
        is_standard = False
    if not is_standard:
        raise CaptureError(f"{name}: the file's definition of {kind} is not that of ROS 2 Humble")
