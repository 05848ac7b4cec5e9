"""The messages of a stored episode: topics and values as ``export --to rosbag2`` writes them."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path

from grasp_factory.capture.ros2.playing import Played, PlayedMessage, TopicPlayer
from grasp_factory.capture.ros2.topic_choice import TopicChoice
from grasp_factory.dataset.dataset import Dataset
from grasp_factory.writers.exporters.rosbag.bag_files import ros2_types
from grasp_factory.writers.exporters.rosbag.episode_messages import episode_messages
from grasp_factory.writers.exporters.rosbag.message_maker import MessageMaker
from grasp_factory.writers.exporters.rosbag.topics import BagScene, Topic, scene_of
from grasp_factory.writers.exporters.selection import EpisodeSource, select


def play_episode(
    store: Path,
    row: int,
    choice: TopicChoice,
    player: TopicPlayer,
    *,
    on_start: Callable[[int], None] = lambda total: None,
    on_message: Callable[[], None] = lambda: None,
) -> Played:
    """Play an episode of a store.

    Args:
        store: where it is.
        row: the episode.
        choice: its topics.
        player: what announces and sends.
        on_start: called with the number of messages.
        on_message: called after each.

    Raises:
        UsageError: if the row has no episode, or for a topic that it has not.
        StoreError: if it is damaged.
        CaptureError: see ``TopicPlayer``.
    """
    messages = EpisodeMessages(Dataset(store, checked=True), row, choice)
    player.announce(list(messages.topics.values()))
    player.wait_for_subscribers()
    on_start(messages.total)
    return player.play(messages, on_message)


class EpisodeMessages:
    """The messages of an episode, and how many there are.

    Attributes:
        topics: those to announce, by the name in an export.
        total: the number of messages.
    """

    def __init__(self, source: EpisodeSource, row: int, choice: TopicChoice) -> None:
        """Read an episode.

        Raises:
            UsageError: if the row has no episode, or for a topic that it has not.
            StoreError: if it is damaged.
        """
        selection = select([(source, [row])])
        self._types = ros2_types()
        self._scene: BagScene = scene_of(selection, 0, selection[0], MessageMaker(self._types))
        there: dict[str, Topic] = {}
        counts: dict[str, int] = {}
        for _, topic, _ in episode_messages(self._scene):
            there.setdefault(topic.name, topic)
            counts[topic.name] = counts.get(topic.name, 0) + 1
        self.topics = choice.chosen(there)
        self.total = sum(counts[name] for name in self.topics)

    def __iter__(self) -> Iterator[PlayedMessage]:
        """Yield the messages in the order of their stamps."""
        for stamp, topic, message in episode_messages(self._scene):
            if new := self.topics.get(topic.name):
                data = self._types.serialize_cdr(message, topic.kind, little_endian=True)
                yield PlayedMessage(stamp, new.name, bytes(data))
