"""The commands that look at a recorded session: ``capture info``, ``capture recover``."""

# ruff: noqa: PLC0415

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import click

from grasp_factory.cli.params import AS_JSON, Command
from grasp_factory.cli.printing import print_json, say, say_lines
from grasp_factory.core.optional import require
from grasp_factory.core.text_format import count, size_text, table

if TYPE_CHECKING:
    from grasp_factory.capture.session.clock_state import ClockState
    from grasp_factory.capture.session.session_reading import SessionFacts

SESSION = click.argument("session", metavar="SESSION", type=click.Path(path_type=Path))
MOST_ALARMS = 20
"""Alarms that are printed."""


@click.command(
    cls=Command,
    name="info",
    examples=(
        "grasp-factory capture info session_20260131_120000",
        "grasp-factory capture info kitchen_1 --json",
    ),
)
@SESSION
@AS_JSON
def capture_info(session: Path, *, as_json: bool) -> None:
    """Show what a session holds: rates, gaps, losses, alarms.

    Reads the folder SESSION; one that is being recorded, or whose recorder was killed, is read as
    far as it is whole.
    """
    require("mcap", "rosbags", extra="capture")
    from grasp_factory.capture.session.session_reading import read_session

    facts = read_session(session)
    if as_json:
        print_json(facts)
    else:
        say_lines(_lines(facts))


@click.command(
    cls=Command,
    name="recover",
    examples=(
        "grasp-factory capture recover session_20260131_120000",
        "grasp-factory capture recover kitchen_1 --json",
    ),
)
@SESSION
@AS_JSON
def capture_recover(session: Path, *, as_json: bool) -> None:
    """Make the file of a killed recorder whole.

    Writes session.recovered.mcap beside session.mcap in the folder SESSION, with every whole
    message, and session.json. The original stays as it is.
    """
    require("mcap", "rosbags", extra="capture")
    from grasp_factory.capture.session.recovery import recover

    found = recover(session)
    if as_json:
        print_json(found)
        return
    messages = count(found.messages, "message")
    if found.was_complete:
        say(f"{found.path} is whole, with {messages}: nothing to recover")
        return
    last = f", the last at {found.last}" if found.last else ""
    say(f"{found.path}: {messages}{last}")
    say(
        f"lost: {size_text(found.lost_bytes)} at the end ({found.reason}), and what came in the"
        " 0.5 s before the recorder ended"
    )


def _lines(facts: SessionFacts) -> Iterator[str]:
    from grasp_factory.capture.session.session_reading import dropped_samples

    record = facts.record
    how = f"ended by {record.ended}" if record else "not ended"
    yield f"{facts.path}: {facts.duration_s:.1f} s, {size_text(facts.bytes)}, {how}"
    if not facts.is_complete:
        yield f"its file has no end; if it is not being recorded: capture recover {facts.path}"
    if record and record.clock:
        yield _clock_line(record.clock)
    rows = [("topic", "messages", "Hz", "longest gap", "lost")]
    for topic in facts.topics:
        rate = "-" if topic.rate_hz is None else f"{topic.rate_hz:.4g}"
        gap = "-" if topic.longest_gap_s is None else f"{1e3 * topic.longest_gap_s:.1f} ms"
        rows.append((topic.topic, f"{topic.messages:,}", rate, gap, f"{topic.lost:,}"))
    yield from table(rows, range(1, 5)).splitlines()
    for device, number in dropped_samples(facts).items():
        if number:
            yield f"{device}: {count(number, 'sample')} dropped while it recorded"
    alarms = [event for event in facts.events if event["event"] == "alarm"]
    yield count(len(alarms), "alarm")
    for event in alarms[:MOST_ALARMS]:
        at = (int(event.get("time_ns", 0)) - (facts.start_ns or 0)) / 1e9
        what = f"{event.get('device', '')} {event.get('kind', '')}".strip()
        yield f"  {at:.1f} s  {what}: {event.get('text', '')}"
    if len(alarms) > MOST_ALARMS:
        yield f"  and {len(alarms) - MOST_ALARMS} more; --json prints all"


def _clock_line(clock: ClockState) -> str:
    if not clock.is_synchronised:
        return "the clock of this machine was kept by neither PTP nor NTP"
    within = f"{1e3 * clock.estimated_error_s:.3f} ms, at most {1e3 * clock.largest_error_s:.3f} ms"
    return f"the clock of this machine was kept by PTP or NTP, within {within}"
