"""Which topics there are, found without subscribing to them."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass

from cyclonedds.builtin import BuiltinDataReader, BuiltinTopicDcpsPublication
from cyclonedds.core import InstanceState, Policy

from grasp_factory.capture.ros2.dds_names import ros_topic, ros_type
from grasp_factory.capture.ros2.network import Participant
from grasp_factory.capture.ros2.quality_of_service import Reliability, TopicQuality
from grasp_factory.errors import CaptureError

_POLL_S = 0.05
_MOST_ENDPOINTS = 10_000
MOST_TOPICS = 1000
"""More are not looked at: they would be made up by a stranger."""


@dataclass(frozen=True, slots=True, kw_only=True)
class PublishedTopic:
    """A topic that somebody publishes."""

    name: str
    kinds: tuple[str, ...]
    """Types of its messages; more than one if publishers contradict each other."""
    publishers: int
    is_reliable: bool
    """Whether all publishers send lost messages again."""
    is_latched: bool
    """Whether all publishers keep the last message for late subscribers."""

    def quality(self, depth: int) -> TopicQuality:
        """Return the best quality of service that hears all publishers."""
        reliability = Reliability.RELIABLE if self.is_reliable else Reliability.BEST_EFFORT
        return TopicQuality(reliability=reliability, depth=depth, is_latched=self.is_latched)


class TopicWatch:
    """Notes the publishers of a domain from when it was made."""

    def __init__(self, participant: Participant) -> None:
        """Start."""
        self._participant = participant  # its domain ends when nothing refers to it
        self._own = participant.dds.get_guid()
        self._reader = BuiltinDataReader(participant.dds, BuiltinTopicDcpsPublication)

    def topics(self) -> dict[str, PublishedTopic]:
        """Return what is published now by others, by the topic's name."""
        found: dict[str, list[tuple[str, bool, bool]]] = {}
        for endpoint in self._reader.read(N=_MOST_ENDPOINTS):
            is_there = endpoint.sample_info.instance_state == InstanceState.Alive
            if not is_there or endpoint.participant_key == self._own:
                continue
            name, kind = ros_topic(endpoint.topic_name or ""), ros_type(endpoint.type_name or "")
            if name and kind and (name in found or len(found) < MOST_TOPICS):
                found.setdefault(name, []).append((kind, *_quality(endpoint.qos)))
        return {name: _topic(name, rows) for name, rows in sorted(found.items())}

    def wait_for(self, names: Sequence[str], timeout_s: float) -> dict[str, PublishedTopic]:
        """Return these topics as soon as all of them are published.

        Raises:
            CaptureError: naming those that are not published in time.
        """
        end = time.monotonic() + timeout_s
        while True:
            found = self.topics()
            missing = [name for name in names if name not in found]
            if not missing:
                return {name: found[name] for name in names}
            if time.monotonic() >= end:
                there = ", ".join(found) or "none"
                raise CaptureError(
                    f"nobody publishes {', '.join(missing)} within {timeout_s:g} s; topics that"
                    f" are published: {there}; check the domain id and the interface"
                )
            time.sleep(_POLL_S)


def _quality(qos: object) -> tuple[bool, bool]:
    policies = set(qos)  # type: ignore[call-overload]
    is_reliable = any(isinstance(policy, Policy.Reliability.Reliable) for policy in policies)
    is_latched = bool(policies & {Policy.Durability.TransientLocal, Policy.Durability.Transient})
    return is_reliable, is_latched


def _topic(name: str, rows: Sequence[tuple[str, bool, bool]]) -> PublishedTopic:
    return PublishedTopic(
        name=name,
        kinds=tuple(sorted({kind for kind, _, _ in rows})),
        publishers=len(rows),
        is_reliable=all(is_reliable for _, is_reliable, _ in rows),
        is_latched=all(is_latched for _, _, is_latched in rows),
    )
