"""Reading episodes of the formats ``rosbag1`` and ``rosbag2`` back.

The bag may come from a stranger: it is opened by its descriptor, its own definitions of messages
are not used, and it must be uncompressed, so that it cannot expand.
"""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Iterator, Mapping
from contextlib import closing, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rosbags.interfaces import Connection
from rosbags.rosbag1 import Reader
from rosbags.rosbag1.reader import decompressors
from rosbags.rosbag2.storage_mcap import McapReader
from rosbags.rosbag2.storage_sqlite3 import Sqlite3Reader

from grasp_factory.core import schema
from grasp_factory.core.limits import IMPORT_FILE
from grasp_factory.core.place import Place
from grasp_factory.errors import GraspFactoryError, shown
from grasp_factory.writers.exporters.base import ExportFolder
from grasp_factory.writers.exporters.rosbag import message_rows
from grasp_factory.writers.exporters.rosbag.bag_files import ros1_types, ros2_types
from grasp_factory.writers.exporters.rosbag.camera_topics import ENCODINGS
from grasp_factory.writers.exporters.rosbag.message_maker import number_kind
from grasp_factory.writers.exporters.rosbag.series_topics import SERIES
from grasp_factory.writers.exporters.rosbag.topics import camera_names

_IMAGE = "sensor_msgs/msg/Image"
_STORAGE_READERS: Mapping[str, type[McapReader] | type[Sqlite3Reader]] = {
    "mcap": McapReader,
    "sqlite3": Sqlite3Reader,
}
_SUFFIXES = {"mcap": "mcap", "sqlite3": "db3"}
RawMessage = tuple[Connection, int, bytes]


@dataclass(frozen=True, slots=True, kw_only=True)
class ArrayTopic:
    """A topic that holds arrays of the store."""

    kind: str
    """Type of its messages."""
    paths: tuple[str, ...]
    """The arrays."""
    rows: Callable[[Any], tuple[Any, ...]]
    """Returns a row of each array from a message."""
    pad: int | None = None
    """The part that it has, along the axis of the pads; None for all."""


def read_back_ros1(folder: ExportFolder, place: int) -> dict[str, NDArray[Any]]:
    """Return the arrays of an episode by path; see ``Exporter.read_back``."""
    with _opened(folder.place / f"{place:06d}.bag") as path, _as_value_errors(path):
        with Reader(path) as reader:
            kinds = {chunk.decompressor for chunk in reader.chunks.values()}
            _check_plain(kinds <= {decompressors["none"]})
            return _arrays(folder, reader.messages(), ros1_types().deserialize_ros1)


def read_back_ros2(folder: ExportFolder, place: int) -> dict[str, NDArray[Any]]:
    """Return the arrays of an episode by path; see ``Exporter.read_back``."""
    storage = folder.settings.storage
    file = folder.place / f"{place:06d}/{place:06d}.{_SUFFIXES[storage]}"
    with _opened(file) as path, _as_value_errors(path):
        reader = _STORAGE_READERS[storage](path)
        reader.open()
        with closing(reader):
            _check_plain(not any(chunk.compression for chunk in getattr(reader, "chunks", ())))
            messages = reader.messages(reader.connections)
            return _arrays(folder, messages, ros2_types().deserialize_cdr)


@contextmanager
def _opened(file: Place) -> Iterator[Path]:
    """Yield a path of an open file that leads to no other one, whatever happens to its name."""
    descriptor = file.open()
    try:
        IMPORT_FILE.check(os.fstat(descriptor).st_size, file)
        yield Path(f"/proc/self/fd/{descriptor}")
    finally:
        os.close(descriptor)


@contextmanager
def _as_value_errors(path: Path) -> Iterator[None]:
    """Turn whatever rosbags raises at a damaged bag into a ``ValueError``."""
    try:
        yield
    except (GraspFactoryError, OSError, ValueError):
        raise
    except Exception as error:
        text = str(error).replace(str(path), "the bag")
        raise ValueError(f"{type(error).__name__}: {text}") from None


def _check_plain(is_plain: bool) -> None:
    if not is_plain:
        raise ValueError("the bag is compressed, and an export's is not")


def _arrays(
    folder: ExportFolder,
    messages: Iterator[RawMessage],
    deserialize: Callable[[bytes, str], Any],
) -> dict[str, NDArray[Any]]:
    topics = array_topics(folder)
    rows: dict[tuple[str, int | None], list[Any]] = {
        (path, topic.pad): [] for topic in topics.values() for path in topic.paths
    }
    for connection, _, data in messages:
        topic = topics.get(connection.topic)
        if topic is None:
            continue
        if connection.msgtype != topic.kind:
            raise ValueError(f"{connection.topic}: got {shown(connection.msgtype)}")
        values = topic.rows(deserialize(data, topic.kind))
        for path, row in zip(topic.paths, values, strict=True):
            rows[path, topic.pad].append(row)
    parts: dict[str, list[NDArray[Any]]] = {}
    for (path, pad), found in sorted(rows.items(), key=lambda item: (item[0][0], item[0][1] or 0)):
        parts.setdefault(path, []).append(_array(folder, path, pad, found))
    return {
        path: each[0] if len(each) == 1 else np.stack(each, axis=1) for path, each in parts.items()
    }


def _array(folder: ExportFolder, path: str, pad: int | None, rows: list[Any]) -> NDArray[Any]:
    """Return the rows of an array, or of a pad's part of it, in the store's type and shape."""
    field, size = folder.fields[path], schema.sizes(folder.config, folder.joints)
    shape = tuple(size[dim] if isinstance(dim, str) else dim for dim in field.dims[1:])
    shape = shape if pad is None else shape[1:]
    count = math.prod(shape)
    if any(np.size(row) != count for row in rows):
        raise ValueError(f"{path}: a message has another number of values than {count}")
    kind = field.dtype if field.is_image else None
    return np.array(rows, kind).reshape(len(rows), *shape).astype(field.dtype)


def array_topics(folder: ExportFolder) -> dict[str, ArrayTopic]:
    """Return the topics of a bag that hold arrays, by name."""
    series = {path for path, field in folder.fields.items() if field.length_column}
    found: dict[str, ArrayTopic] = {}
    standard: set[str] = set()
    for row in SERIES:
        if row.rows and set(row.arrays) <= series:
            standard |= set(row.arrays)
            found[row.name] = ArrayTopic(
                kind=row.kind, paths=row.arrays, rows=row.rows, pad=row.pad
            )
    found |= _image_topics(folder)
    pictured = {path for topic in found.values() for path in topic.paths}
    names = camera_names(list(folder.config.cameras))
    for path in series - standard - pictured:
        group, _, inner = path.partition("/")
        camera, _, leaf = inner.partition("/")
        name = f"/cameras/{names[camera]}/video/{leaf}" if leaf else f"/{group}/{inner}"
        found[name] = _number_topic(folder, path)
    return found


def _number_topic(folder: ExportFolder, path: str) -> ArrayTopic:
    field = folder.fields[path]
    dtype = np.dtype("uint8" if field.dtype == "bool" else field.dtype)
    kind = number_kind(np.empty(0, dtype), is_array=len(field.dims) > 1)
    return ArrayTopic(kind=kind, paths=(path,), rows=message_rows.data)


def _image_topics(folder: ExportFolder) -> dict[str, ArrayTopic]:
    found = {}
    for camera, name in camera_names(list(folder.config.cameras)).items():
        topics = {
            "color/image_raw": f"cameras/{camera}/rgb",
            "depth/image_raw": f"cameras/{camera}/depth",
            "segmentation": f"cameras/{camera}/segmentation",
            "video/image_raw": f"videos/{camera}/rgb",
        }
        for topic, path in topics.items():
            if path in folder.fields:
                rows = _image_rows(folder, path)
                found[f"/cameras/{name}/{topic}"] = ArrayTopic(
                    kind=_IMAGE, paths=(path,), rows=rows
                )
    return found


def _image_rows(folder: ExportFolder, path: str) -> Callable[[Any], tuple[Any, ...]]:
    """Return the function that returns the pixels of an image message."""
    field, (width, height) = folder.fields[path], folder.config.resolution
    encoding = ENCODINGS[field.dtype, len(field.dims)]

    def rows(message: Any) -> tuple[Any, ...]:
        got = (message.encoding, message.width, message.height)
        if got != (encoding, width, height):
            raise ValueError(f"{path}: got an image {shown(got)}")
        return (np.asarray(message.data, np.uint8).view(field.dtype),)

    return rows
