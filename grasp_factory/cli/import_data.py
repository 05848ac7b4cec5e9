"""The command that reads ROS bags, and makes stores of exports again: ``import``."""

# ruff: noqa: PLC0415

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from grasp_factory.cli.params import AS_JSON, Command, option
from grasp_factory.cli.printing import print_json, say, say_lines
from grasp_factory.core.optional import require
from grasp_factory.core.text_format import count
from grasp_factory.errors import UsageError

if TYPE_CHECKING:
    from collections.abc import Iterator

    from grasp_factory.apps.bag_import.extraction import BagImport
    from grasp_factory.apps.bag_import.topic_listing import BagFacts


@click.command(
    cls=Command,
    name="import",
    examples=(
        "grasp-factory import drive.bag --list",
        "grasp-factory import drive.bag frames --to sequences",
        "grasp-factory import drive.mcap frames --to article --topics /image_raw",
        "grasp-factory import exported again.zarr",
    ),
)
@click.argument("source", metavar="SOURCE", type=click.Path(path_type=Path))
@click.argument("out", metavar="[OUT]", required=False, type=click.Path(path_type=Path))
@option(
    "--to",
    "layout",
    metavar="LAYOUT",
    help="Layout of the files from a bag: sequences or article.",
)
@option(
    "--topics",
    metavar="NAME,...",
    multiple=True,
    help="Import these topics only. Repeatable.",
)
@option(
    "--list", "as_list", is_flag=True, help="List topics with rate and longest gap, or an export."
)
@AS_JSON
def import_(
    source: Path,
    out: Path | None,
    *,
    layout: str | None,
    topics: tuple[str, ...],
    as_list: bool,
    as_json: bool,
) -> None:
    """Extract a ROS bag, or make a store of an export again.

    If SOURCE is a bag of ROS 1 or ROS 2, writes its images, depth, camera info, IMU, odometry,
    joint states and wrenches to the folder OUT, by the stamps of their headers.
    grasp_factory_import.json says what became of each topic. If SOURCE is a folder that `export`
    wrote, writes a store to OUT, with every array that the format holds. OUT must not exist; it
    appears when it is complete.
    """
    from grasp_factory.writers.exporters.export_record import RECORD

    if (source / RECORD).exists():
        if layout is not None or topics:
            raise UsageError(f"{source} is an export, and --to and --topics are for bags")
        if as_list:
            _print_export(source, as_json=as_json)
        elif out is None:
            raise UsageError(
                f"{source} is an export: name OUT, the path of the new store; --list says what it"
                " has"
            )
        else:
            _restore(source, out, as_json=as_json)
        return
    if not source.exists():
        raise UsageError(f"{source} does not exist; valid: a bag of ROS 1 or ROS 2, or an export")
    require("rosbags", extra="ros")
    from grasp_factory.apps.bag_import.importing import import_bag, list_topics
    from grasp_factory.capture.bags.bag_file import bag_suffix

    if as_list:
        _print_bag(list_topics(source), as_json=as_json)
        return
    if out is None or layout is None:
        bag_suffix(source)
        raise UsageError(
            f"{source} is a bag: name OUT, and --to sequences or --to article; --list lists the"
            " topics"
        )
    from grasp_factory.cli.bars import counted

    names = [name for text in topics for name in text.split(",")]
    with counted("on_step", "%") as hooks:
        found = import_bag(source, out, layout, names, **hooks)
    if as_json:
        print_json(found)
    else:
        say_lines(_import_lines(out, found))


def _restore(export: Path, out: Path, *, as_json: bool) -> None:
    from grasp_factory.cli.bars import counted
    from grasp_factory.curation.restore import restore

    with counted("on_episode") as hooks:
        found = restore(export, out, **hooks)
    if as_json:
        print_json(found)
        return
    lines = [
        f"{out}: {count(found.episodes, 'episode')} from {found.format},"
        f" {found.same} of them the same in every value as in the store that was exported"
    ]
    if found.others and not found.not_held:
        more = " and more" if found.episodes - found.same > len(found.others) else ""
        lines.append(f"episodes that are not the same: {', '.join(map(str, found.others))}{more}")
    if found.labels:
        lines.append(f"added labels: {', '.join(found.labels)}")
    if found.annotations:
        lines.append(f"annotations of {count(found.annotations, 'episode')}")
    if found.not_held:
        lines.append(f"not in the export, so empty: {', '.join(found.not_held)}")
    say_lines(lines)


def _print_export(export: Path, *, as_json: bool) -> None:
    from grasp_factory.curation.restore import list_export

    found = list_export(export)
    if as_json:
        print_json(found)
        return
    lines = [
        f"{export}: {count(found.episodes, 'episode')} as {found.format},"
        f" {'can' if found.can_be_imported else 'cannot'} be imported",
        f"stores: {', '.join(found.stores)}",
        f"arrays of the stores: {', '.join(found.arrays)}",
    ]
    if found.labels:
        lines.append(f"added labels: {', '.join(found.labels)}")
    if found.annotations:
        lines.append(f"annotations of {count(found.annotations, 'episode')}")
    say_lines(lines)


def _print_bag(bag: BagFacts, *, as_json: bool) -> None:
    if as_json:
        print_json(bag)
        return
    if not bag.topics:
        say("the bag has no topics")
    for topic in bag.topics:
        rate = "-" if topic.rate_hz is None else f"{topic.rate_hz:.6g} Hz"
        gap = "-" if topic.longest_gap_s is None else f"{topic.longest_gap_s:.6g} s"
        messages = count(topic.count, "message")
        say_lines([f"{topic.name}: {topic.kind}, {messages}, {rate}, longest gap {gap}"])
    say_lines(_lost_lines(bag.without_topic))


def _import_lines(out: Path, found: BagImport) -> Iterator[str]:
    imported = sum(topic.imported for topic in found.topics)
    topics = count(len(found.topics), "topic")
    yield f"{out}: {count(imported, 'message')} of {topics} as {found.layout}"
    for topic in found.topics:
        yield f"{topic.name}: {count(topic.imported, 'message')}"
        if topic.undecodable:
            lost = count(topic.undecodable, "message")
            yield f"{topic.name}: {lost} could not be decoded, the first because {topic.reason}"
        if topic.without_stamp:
            yield f"{topic.name}: {topic.without_stamp} without a stamp have the time of arrival"
    for name, reason in found.left_out.items():
        yield f"{name}: left out, because {reason}"
    yield from _lost_lines(found.without_topic)


def _lost_lines(messages: int) -> Iterator[str]:
    if messages:
        yield f"{count(messages, 'message')} cannot be read: the bag does not name their topics"
