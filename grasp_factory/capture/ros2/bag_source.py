"""Playing the messages of a bag of ROS 2, or of a recorded session, as topics.

The bag may be anybody's: a process with limits reads it, and hands over bytes. They are sent as
they are.
"""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

from rosbags.highlevel import AnyReader
from rosbags.interfaces import Connection, QosDurability

from grasp_factory.capture.bags.bag_file import bag_suffix, opened, raw_messages
from grasp_factory.capture.ros2.message_types import knows_type, type_hash
from grasp_factory.capture.ros2.playing import Played, PlayedMessage, TopicPlayer
from grasp_factory.capture.ros2.topic_choice import TopicChoice
from grasp_factory.core.executors.base import SendMessage
from grasp_factory.core.executors.import_process import in_import_process
from grasp_factory.core.scratch_folder import scratch_folder
from grasp_factory.errors import UsageError
from grasp_factory.writers.exporters.rosbag.topics import Topic

SESSION_FILE = "session.mcap"
"""The messages of a session, in its folder."""


@dataclass(frozen=True, slots=True, kw_only=True)
class BagJob:
    """What is read from a bag."""

    bag: Path
    aside: Path
    """A folder for temporary files."""
    choice: TopicChoice


@dataclass(frozen=True, slots=True, kw_only=True)
class Announcement:
    """What a bag is going to send."""

    topics: Mapping[str, Topic]
    """By the name in the bag."""
    total: int
    """Number of messages."""


def bag_at(path: Path) -> Path:
    """Return the bag at a path: that of a session if the path is its folder."""
    return path / SESSION_FILE if (path / SESSION_FILE).is_file() else path


def play_bag(
    path: Path,
    choice: TopicChoice,
    player: TopicPlayer,
    *,
    on_start: Callable[[int], None] = lambda total: None,
    on_message: Callable[[], None] = lambda: None,
) -> Played:
    """Play a bag.

    Args:
        path: a bag of ROS 2, or the folder of a session.
        choice: its topics.
        player: what announces and sends.
        on_start: called with the number of messages.
        on_message: called after each.

    Raises:
        UsageError: if it is no bag of ROS 2, or for a topic that it has not.
        StoreError: if it is damaged, or needs too much memory or time.
        CaptureError: see ``TopicPlayer``.
    """
    bag = bag_at(path)
    bag_suffix(bag)

    def receive(found: Announcement | PlayedMessage) -> None:
        if isinstance(found, Announcement):
            player.announce(list(found.topics.values()))
            player.wait_for_subscribers()
            player.begin()
            on_start(found.total)
        else:
            player.send(found)
            on_message()

    with scratch_folder(Path(tempfile.gettempdir()), "grasp-factory-bag") as aside:
        job = BagJob(bag=bag, aside=aside, choice=choice)
        in_import_process(hand_over, job, bag, receive)
    return player.finish()


def hand_over(job: BagJob, report: SendMessage) -> None:
    """Report what a bag is going to send, and then each message.

    Raises:
        UsageError: if it is no bag of ROS 2, or for a topic that it has not.
        StoreError: if it is damaged.
    """
    with opened(job.bag, job.aside) as reader:
        if not reader.is2:
            raise UsageError(
                f"{job.bag} is a bag of ROS 1, valid: one of ROS 2; `rosbags-convert` makes one"
            )
        known = [each for each in reader.connections if _can_be_sent(reader, each)]
        there = {each.topic: _topic(each) for each in known}
        if not there:
            raise UsageError(f"{job.bag} has no messages of a type of ROS 2 Humble")
        topics = job.choice.chosen(there)
        chosen = [each for each in known if each.topic in topics]
        report(Announcement(topics=topics, total=sum(each.msgcount for each in chosen)))
        for connection, time, data in raw_messages(job.bag, reader, chosen):
            report(PlayedMessage(time, topics[connection.topic].name, bytes(data)))


def _can_be_sent(reader: AnyReader, connection: Connection) -> bool:
    """Return whether the bag means by a type what ROS 2 Humble means by it."""
    kind = connection.msgtype
    return knows_type(kind) and reader.typestore.hash_rihs01(kind) == type_hash(kind)


def _topic(connection: Connection) -> Topic:
    profiles = getattr(connection.ext, "offered_qos_profiles", ())
    is_latched = any(each.durability is QosDurability.TRANSIENT_LOCAL for each in profiles)
    return Topic(name=connection.topic, kind=connection.msgtype, is_latched=is_latched)
