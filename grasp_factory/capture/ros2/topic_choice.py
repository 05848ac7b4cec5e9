"""Which topics of a recording are played, and under which names."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from grasp_factory.capture.ros2.dds_names import check_topic
from grasp_factory.errors import UsageError, lookup, shown
from grasp_factory.writers.exporters.rosbag.topics import Topic


@dataclass(frozen=True, slots=True, kw_only=True)
class TopicChoice:
    """Which topics of a recording are played, and under which names."""

    topics: tuple[str, ...] = ()
    """Their names in the recording; none for all."""
    names: Mapping[str, str]
    """Other names, by the name in the recording."""

    def chosen(self, there: Mapping[str, Topic]) -> dict[str, Topic]:
        """Return the topics to play, with their new names, by the name in the recording.

        Raises:
            UnknownNameError: for a topic that the recording has not.
            UsageError: for a name that ROS does not have, or that two topics would have.
        """
        for name in (*self.topics, *self.names):
            lookup(there, "topic", name)
        found = {
            name: replace(topic, name=self.names.get(name, name))
            for name, topic in there.items()
            if not self.topics or name in self.topics
        }
        new = [topic.name for topic in found.values()]
        for name in new:
            check_topic(name)
        if twice := {name for name in new if new.count(name) > 1}:
            raise UsageError(f"--remap: two topics would be {shown(min(twice))}; name one each")
        return found


def parse_names(texts: Sequence[str]) -> dict[str, str]:
    """Return new names of topics by old name, from texts FROM:=TO as in ROS.

    Raises:
        UsageError: for a text of another form.
    """
    found: dict[str, str] = {}
    for text in texts:
        old, sign, new = text.partition(":=")
        if not sign or old in found:
            raise UsageError(f"--remap: got {shown(text)}, valid: /old:=/new, each old name once")
        check_topic(new)
        found[old] = new
    return found
