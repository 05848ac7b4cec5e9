"""Reading a bag: its topics, or its messages into the files of a layout."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path

from rosbags.highlevel import AnyReader

from grasp_factory.apps.bag_import.article_layout import ArticleLayout
from grasp_factory.apps.bag_import.bag_topics import (
    LONGEST_REASON,
    BagTopic,
    choose_topics,
    reasons,
)
from grasp_factory.apps.bag_import.import_layout import ImportLayout
from grasp_factory.apps.bag_import.sequence_layout import SequenceLayout
from grasp_factory.apps.bag_import.topic_listing import BagFacts, facts_of, without_topic
from grasp_factory.capture.bags.bag_file import opened, raw_messages
from grasp_factory.capture.bags.messages import message_of, stamp_ns_of
from grasp_factory.core.executors import SendMessage
from grasp_factory.errors import StoreError, UsageError, shown

LAYOUTS: Mapping[str, Callable[[Path, Sequence[BagTopic]], ImportLayout]] = {
    "sequences": SequenceLayout,
    "article": ArticleLayout,
}
STEPS = 100
"""How often an import reports at most."""
_LATEST_NS = 2**63 - 1
"""Times of arrival in MCAP files may be later; they become this one."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ImportJob:
    """The task of the process that reads a bag."""

    bag: Path
    folder: Path
    """An empty folder to fill."""
    aside: Path
    """A folder for temporary files."""
    layout: str
    """A name of ``LAYOUTS``."""
    topics: tuple[str, ...]
    """None for all."""


@dataclass(slots=True, kw_only=True)
class ImportedTopic:
    """What became of a topic's messages."""

    name: str
    kind: str
    """Type of the messages."""
    imported: int = 0
    undecodable: int = 0
    """Messages that could not be decoded."""
    reason: str = ""
    """Why the first of them could not."""
    without_stamp: int = 0
    """Messages whose header has no stamp: they have the time of their arrival."""


@dataclass(frozen=True, slots=True, kw_only=True)
class BagImport:
    """What an import wrote."""

    bag: str
    """Name of the bag."""
    layout: str
    topics: tuple[ImportedTopic, ...]
    left_out: Mapping[str, str]
    """The other topics with the reason."""
    without_topic: int
    """Messages that belong to none of the bag's topics: they cannot be read."""


def listed(job: tuple[Path, Path], report: SendMessage) -> BagFacts:
    """Return what is in a bag; the job is the bag and a folder for temporary files."""
    bag, aside = job
    with opened(bag, aside) as reader:
        return facts_of(bag, reader)


def extract(job: ImportJob, report: SendMessage) -> BagImport:
    """Fill the folder of a job, and report each of ``STEPS``.

    Raises:
        UsageError: if nothing can be imported, or not what was asked for.
        StoreError: if the bag is damaged.
        OSError: if a file cannot be written.
    """
    with opened(job.bag, job.aside) as reader:
        chosen, left_out = choose_topics(job.bag, reader, job.topics)
        with closing(LAYOUTS[job.layout](job.folder, chosen)) as layout:
            for name in sorted(layout.left_out.keys() & set(job.topics)):
                raise UsageError(f"{job.bag}: {name} cannot be imported: {layout.left_out[name]}")
            left_out |= layout.left_out
            topics = [topic for topic in chosen if topic.name not in left_out]
            if not topics:
                why = reasons(left_out)
                raise UsageError(f"{job.bag}: the layout can hold none of its topics ({why})")
            found = _add_messages(job.bag, reader, layout, topics, report)
            layout.finish()
            lost = without_topic(reader)
    return BagImport(
        bag=job.bag.name,
        layout=job.layout,
        topics=found,
        left_out=left_out,
        without_topic=lost,
    )


def _add_messages(
    bag: Path,
    reader: AnyReader,
    layout: ImportLayout,
    topics: Sequence[BagTopic],
    report: SendMessage,
) -> tuple[ImportedTopic, ...]:
    """Add all messages to the layout.

    Raises:
        StoreError: if the bag is damaged, or no message of a topic can be decoded.
    """
    by_name = {topic.name: topic for topic in topics}
    found = {topic.name: ImportedTopic(name=topic.name, kind=topic.kind) for topic in topics}
    connections = [connection for topic in topics for connection in topic.connections]
    total, steps = sum(connection.msgcount for connection in connections), 0
    for done, (connection, arrival, data) in enumerate(raw_messages(bag, reader, connections), 1):
        entry = found.get(connection.topic)
        if entry is None:
            raise StoreError(f"{bag} is damaged: a topic has messages of {shown(connection.topic)}")
        try:
            message = message_of(reader, connection, data)
            stamp = stamp_ns_of(message)
            time = min(arrival, _LATEST_NS) if stamp is None else stamp
            layout.add(by_name[connection.topic], time, message)
            entry.without_stamp += stamp is None
            entry.imported += 1
        except ValueError as error:
            entry.undecodable += 1
            entry.reason = entry.reason or str(error)[:LONGEST_REASON]
        while steps < min(done * STEPS // max(total, 1), STEPS):
            steps += 1
            report(steps)
    for entry in found.values():
        if not entry.imported:
            raise StoreError(
                f"{bag}: none of {entry.undecodable} messages of {entry.name} can be decoded:"
                f" {entry.reason}; choose others with --topics"
            )
    return tuple(found.values())
