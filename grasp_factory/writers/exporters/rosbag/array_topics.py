"""Arrays that no other message fits: numbers and arrays of std_msgs, with named dimensions."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from grasp_factory.core.schema import dimension_names
from grasp_factory.writers.exporters.rosbag.message_maker import number_kind
from grasp_factory.writers.exporters.rosbag.topics import START_NS, BagScene, StampedMessage, Topic

_NAMES = dimension_names()


def array_messages(
    scene: BagScene, path: str, name: str, times: Sequence[int], values: NDArray[Any]
) -> Iterator[StampedMessage]:
    """Yield a message for each row of an array.

    Args:
        scene: the episode.
        path: the array's path in the store; its field names the dimensions.
        name: the topic.
        times: the rows' stamps, ns.
        values: (rows, ...).
    """
    values = values.astype(np.uint8) if values.dtype.kind == "b" else values
    kind = number_kind(values, is_array=values.ndim > 1)
    topic = Topic(name=name, kind=kind)
    if values.ndim == 1:
        for stamp, number in zip(times, values.tolist(), strict=True):
            yield StampedMessage(stamp, topic, scene.make(kind, data=number))
        return
    layout = scene.make.layout(_sizes(scene, path, values.shape[1:]))
    for stamp, row in zip(
        times, values.reshape(len(values), math.prod(values.shape[1:])), strict=True
    ):
        yield StampedMessage(stamp, topic, scene.make(kind, layout=layout, data=row))


def constant_message(scene: BagScene, path: str, values: NDArray[Any]) -> StampedMessage:
    """Return the message of an array that has one value for the episode, on a latched topic."""
    kind = number_kind(values, is_array=True)
    layout = scene.make.layout(_sizes(scene, path, values.shape))
    message = scene.make(kind, layout=layout, data=values.ravel())
    return StampedMessage(START_NS, Topic(name=f"/{path}", kind=kind, is_latched=True), message)


def _sizes(scene: BagScene, path: str, shape: Sequence[int]) -> dict[str, int]:
    """Return name and length of each dimension; one without a name is called by its position."""
    dims = scene.fields[path].dims[-len(shape) :]
    names = [_NAMES.get(str(dim), f"axis_{k}") for k, dim in enumerate(dims)]
    return dict(zip(names, shape, strict=True))
