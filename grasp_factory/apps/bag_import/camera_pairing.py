"""Which images, depth images and calibration belong to one camera, by the names of their topics."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from grasp_factory.apps.bag_import.bag_topics import BagTopic, TopicRole

_TRANSPORTS = ("/compressed", "/compressedDepth")
"""Ends of topics of compressed images; the camera info is beside the uncompressed ones."""
_COLOUR_WORDS = ("color", "colour", "rgb")


@dataclass(frozen=True, slots=True, kw_only=True)
class CameraTopics:
    """The topics of a camera; what it lacks is None."""

    colour: BagTopic | None = None
    depth: BagTopic | None = None
    colour_info: BagTopic | None = None
    depth_info: BagTopic | None = None


def pair_cameras(topics: Sequence[BagTopic]) -> list[CameraTopics]:
    """Return the cameras, in the order of their colour topics; then depth without colour.

    A depth topic goes to the colour topic with which it shares most of its name, one to each;
    those that are aligned to the colour image choose first.
    """
    infos = {topic.name: topic for topic in topics if topic.role is TopicRole.CAMERA_INFO}
    colours = [topic for topic in topics if topic.role is TopicRole.COLOUR]
    depths = [topic for topic in topics if topic.role is TopicRole.DEPTH]
    depth_of: dict[str, BagTopic] = {}
    for depth in sorted(depths, key=lambda topic: ("aligned" not in topic.name, topic.name)):
        free = [colour for colour in colours if colour.name not in depth_of]
        if best := max(free, key=lambda colour: _likeness(colour, depth), default=None):
            if _shared(colour=best, depth=depth) or len(colours) == len(depths) == 1:
                depth_of[best.name] = depth
    paired = {depth.name for depth in depth_of.values()}
    pairs = [(colour, depth_of.get(colour.name)) for colour in colours]
    alone = [(None, depth) for depth in depths if depth.name not in paired]
    return [
        CameraTopics(
            colour=colour,
            depth=depth,
            colour_info=infos.get(info_name(colour.name)) if colour else None,
            depth_info=infos.get(info_name(depth.name)) if depth else None,
        )
        for colour, depth in [*pairs, *alone]
    ]


def info_name(image_topic: str) -> str:
    """Return the topic of an image topic's calibration: ``camera_info`` in the same namespace."""
    for transport in _TRANSPORTS:
        image_topic = image_topic.removesuffix(transport)
    return f"{image_topic.rpartition('/')[0]}/camera_info"


def _likeness(colour: BagTopic, depth: BagTopic) -> tuple[int, bool]:
    return _shared(colour, depth), any(word in colour.name for word in _COLOUR_WORDS)


def _shared(colour: BagTopic, depth: BagTopic) -> int:
    """Return how many parts of their names are the same, from the first one on."""
    pairs = zip(colour.name.split("/")[1:], depth.name.split("/")[1:], strict=False)
    same = [a == b for a, b in pairs]
    return same.index(False) if False in same else len(same)
