"""The commands that read topics of ROS 2: ``capture topics`` and ``capture collect``."""

# ruff: noqa: PLC0415

from __future__ import annotations

import time
from pathlib import Path
from typing import TYPE_CHECKING

import click

from grasp_factory.cli.params import AS_JSON, Command, option
from grasp_factory.cli.printing import print_json, say, say_lines
from grasp_factory.cli.ros2_options import domain_options, participant_of
from grasp_factory.core.serialization import to_plain
from grasp_factory.core.text_format import count, size_text, table

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from grasp_factory.capture.ros2.collecting import Collection
    from grasp_factory.capture.ros2.topic_rates import TopicReport

_NAMES = option(
    "--topics",
    "names",
    metavar="NAME,...",
    multiple=True,
    help="Topics, or `all` for all that are there. Repeatable.",
)
_WAIT = option(
    "--wait",
    "wait_s",
    metavar="SECONDS",
    type=click.FloatRange(0.0, 86400.0),
    default=10.0,
    show_default=True,
    help="Longest time to wait for the topics to be published. The command fails if one is not.",
)


@click.command(
    cls=Command,
    examples=(
        "grasp-factory capture topics",
        "grasp-factory capture topics --topics /imu/data --seconds 5",
    ),
)
@_NAMES
@option(
    "--look",
    "look_s",
    metavar="SECONDS",
    type=click.FloatRange(0.1, 3600.0),
    default=2.0,
    show_default=True,
    help="How long to look for topics, if none are named.",
)
@option(
    "--seconds",
    metavar="SECONDS",
    type=click.FloatRange(0.1, 3600.0),
    default=2.0,
    show_default=True,
    help="How long to count messages.",
)
@_WAIT
@domain_options
@AS_JSON
def topics(
    *,
    names: tuple[str, ...],
    look_s: float,
    seconds: float,
    wait_s: float,
    domain: int,
    interface: str,
    as_json: bool,
) -> None:
    """List topics of ROS 2 with type and rate.

    Each line has the type, the publishers, the rate, the longest gap and the data rate.
    """
    participant = participant_of(domain, interface)
    from grasp_factory.capture.ros2.topic_rates import report_topics

    chosen = _chosen(names)
    found = report_topics(participant, chosen, wait_s if chosen else look_s, seconds)
    if as_json:
        print_json(found)
    elif found:
        say(_topics_table(found))
    else:
        say(f"no topics are published in domain {domain} on the interface {interface}")


@click.command(
    cls=Command,
    examples=(
        "grasp-factory capture collect --seconds 30",
        "grasp-factory capture collect --topics /imu/data,/joint_states --out arm.mcap",
        "grasp-factory capture collect --topics all --silence 2 --out everything.mcap",
    ),
)
@_NAMES
@option(
    "--out",
    metavar="FILE",
    type=click.Path(path_type=Path),
    help="The MCAP file.  [default: ego_data_DATE_TIME.mcap]",
)
@option("--seconds", metavar="SECONDS", type=float, help="Length.  [default: until Ctrl-C]")
@option(
    "--silence",
    "silence_s",
    metavar="SECONDS",
    type=float,
    help="End when no message has come for so long.",
)
@option(
    "--depth",
    metavar="N",
    type=click.IntRange(0, 100_000),
    default=0,
    show_default=True,
    help="Messages of a topic that are kept until they are taken; 0 keeps all.",
)
@option("--strict", is_flag=True, help="Exit with 1 if a message is missing or was dropped.")
@_WAIT
@domain_options
@AS_JSON
def collect(
    *,
    names: tuple[str, ...],
    out: Path | None,
    seconds: float | None,
    silence_s: float | None,
    depth: int,
    strict: bool,
    wait_s: float,
    domain: int,
    interface: str,
    as_json: bool,
) -> None:
    """Collect topics of ROS 2 into an MCAP file.

    Without --topics, collects those of a usual mobile robot that are there: colour and depth
    images, camera info, IMU, odometry, velocity commands and joint states. Messages that are
    missing are counted by the stamps of their headers.
    """
    participant = participant_of(domain, interface)
    import threading

    from grasp_factory.capture.ros2.collected_topics import topics_to_collect
    from grasp_factory.capture.ros2.collecting import CollectSettings, TopicCollector
    from grasp_factory.capture.ros2.network import small_socket_buffers
    from grasp_factory.core.progress import Progress
    from grasp_factory.errors import CaptureError

    settings = CollectSettings(seconds=seconds, silence_s=silence_s, depth=depth)
    chosen = topics_to_collect(participant, _split(names), wait_s)
    path = out or Path(time.strftime("ego_data_%Y%m%d_%H%M%S.mcap"))
    collector = TopicCollector(participant, chosen.topics, path, settings)
    with Progress(0, "message") as progress:
        found = collector.collect(progress.count, threading.Event())
    if as_json:
        print_json(to_plain(found) | {"path": str(path), "left_out": chosen.left_out})
    else:
        say_lines(_collection_lines(found))
        say_lines(f"{name}: not collected, because {why}" for name, why in chosen.left_out.items())
    lost = sum((topic.missing or 0) + topic.dropped for topic in found.topics)
    if lost and (hint := small_socket_buffers()):
        say(hint, err=True)
    if lost and strict:
        raise CaptureError(f"{path}: {count(lost, 'message')} missing")


def _split(names: tuple[str, ...]) -> list[str]:
    return [name for text in names for name in text.split(",")]


def _chosen(names: tuple[str, ...]) -> list[str]:
    """Return the named topics; none if all are meant."""
    chosen = _split(names)
    return [] if chosen == ["all"] else chosen


def _topics_table(found: Sequence[TopicReport]) -> str:
    rows: list[tuple[str, ...]] = [("topic", "type", "publishers", "rate", "longest gap", "data")]
    for topic in found:
        rate = "-" if topic.rate_hz is None else f"{topic.rate_hz:.4g} Hz"
        gap = "-" if topic.longest_gap_s is None else f"{1e3 * topic.longest_gap_s:.4g} ms"
        data = f"{size_text(topic.bytes_per_s)}/s"
        kinds = ", ".join(topic.kinds) + ("" if topic.can_be_collected else " (unknown)")
        marks = topic.reliability + (", latched" if topic.is_latched else "")
        rows.append((topic.name, kinds, f"{topic.publishers} {marks}", rate, gap, data))
    return table(rows, right=(3, 4, 5))


def _collection_lines(found: Collection) -> Iterator[str]:
    messages = sum(topic.count for topic in found.topics)
    yield (
        f"{found.path}: {count(messages, 'message')} of {count(len(found.topics), 'topic')} in"
        f" {found.duration_s:.1f} s, {size_text(found.bytes)}"
    )
    for topic in found.topics:
        rate = "" if topic.rate_hz is None else f", {topic.rate_hz:.6g} Hz"
        line = f"{topic.name}: {count(topic.count, 'message')}{rate}"
        line += ", no stamps" if topic.missing is None else f", {topic.missing} missing"
        if topic.dropped:
            line += f", {topic.dropped} dropped because the disk was too slow"
        if topic.backward:
            line += f", {count(topic.backward, 'stamp')} not later than the one before"
        yield line
