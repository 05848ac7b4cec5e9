"""Where the episodes of a session begin and end."""

from __future__ import annotations

import csv
import itertools
import os
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from grasp_factory.capture.importing.gripper_motion import GripperClosing
from grasp_factory.capture.importing.import_settings import CutMethod, ImportSettings
from grasp_factory.capture.importing.session_contents import RecordedEvent
from grasp_factory.capture.session.events import EPISODE_END, EPISODE_START
from grasp_factory.core.enums import Outcome, names
from grasp_factory.core.regular_file import open_regular
from grasp_factory.errors import CaptureError, UsageError, shown

MARK, LABEL = "mark", "label"
"""Events: two marks are a start and an end; a label has ``outcome``."""
_MOST_CHARACTERS = 10_000_000
_COLUMNS = ("start", "end", "outcome")
_LATEST_S = 1e7
_LATE_NS = 1_000_000_000
"""How much later than the session an episode of a list may end; it then ends with the session."""
_VALID = "start and end in seconds, start first, and an outcome such as success or nothing"


@dataclass(frozen=True, slots=True, kw_only=True)
class Cut:
    """An episode's part of a session."""

    start_ns: int
    """ns since the epoch."""
    end_ns: int
    outcome: str = ""
    """What the list of cuts says; empty if it says nothing."""


def cuts_of(
    events: Sequence[RecordedEvent],
    closings: Sequence[GripperClosing],
    span_ns: tuple[int, int],
    settings: ImportSettings,
    listed: Sequence[Cut] = (),
) -> tuple[Cut, ...]:
    """Return the episodes of a session in the order of their starts; none overlaps another.

    Args:
        events: of the session, by time.
        closings: of its gripper.
        span_ns: its first and last time.
        settings: the method.
        listed: the list, for that method.

    Raises:
        CaptureError: if no episode is found, if two of a list overlap, or if one is outside.
    """
    if settings.cut is CutMethod.LIST:
        found = _inside(sorted(listed, key=lambda cut: cut.start_ns), span_ns)
    elif settings.cut is CutMethod.GRIPPER:
        found = _by_gripper(closings, span_ns, settings)
    else:
        found = _by_events(events, span_ns)
    check_apart(found, span_ns[0])
    if not found:
        raise CaptureError(
            f"no episode was found by {settings.cut.name.lower()}; valid: --cut events, --cut"
            " gripper, or --cuts FILE with start,end in seconds from the session's start"
        )
    return tuple(found)


def check_apart(cuts: Sequence[Cut], origin_ns: int) -> None:
    """Raise CaptureError if one of some episodes in their order begins before the last one ends.

    Args:
        cuts: the episodes.
        origin_ns: the session's start on their clock.
    """
    for before, after in itertools.pairwise(cuts):
        if after.start_ns <= before.end_ns:
            at = (after.start_ns - origin_ns) / 1e9
            raise CaptureError(f"the episode from {at:.3f} s on begins before the last one ends")


def _inside(cuts: Sequence[Cut], span_ns: tuple[int, int]) -> list[Cut]:
    """Return the episodes of a list, whose times are rounded: the last may end a little late."""
    first, last = span_ns
    for cut in cuts:
        if cut.end_ns > last + _LATE_NS or cut.start_ns >= last:
            start, end, length = ((at - first) / 1e9 for at in (cut.start_ns, cut.end_ns, last))
            raise CaptureError(
                f"the episode from {start:.3f} to {end:.3f} s is not inside of the session, which"
                f" is {length:.3f} s long"
            )
    return [replace(cut, end_ns=min(cut.end_ns, last)) for cut in cuts]


def _by_events(events: Sequence[RecordedEvent], span_ns: tuple[int, int]) -> list[Cut]:
    named = [event for event in events if event.name in (EPISODE_START, EPISODE_END)]
    if not named:
        marks = [event.time_ns for event in events if event.name == MARK]
        pairs = zip(marks[::2], marks[1::2], strict=False)
        return [Cut(start_ns=a, end_ns=b) for a, b in pairs if a < b]
    found, start = [], None
    for event in named:
        if start is not None and event.time_ns > start:
            found.append(Cut(start_ns=start, end_ns=event.time_ns - (event.name == EPISODE_START)))
        start = event.time_ns if event.name == EPISODE_START else None
    if start is not None and start < span_ns[1]:
        found.append(Cut(start_ns=start, end_ns=span_ns[1]))
    return found


def _by_gripper(
    closings: Sequence[GripperClosing], span_ns: tuple[int, int], settings: ImportSettings
) -> list[Cut]:
    before, after = round(settings.before_s * 1e9), round(settings.after_s * 1e9)
    found: list[Cut] = []
    for closing in closings:
        end = span_ns[1] if closing.opens_ns is None else min(span_ns[1], closing.opens_ns + after)
        start = max(span_ns[0], closing.begins_ns - before)
        if found and start <= found[-1].end_ns:
            start = found[-1].end_ns + 1
        if start < closing.begins_ns < end:
            found.append(Cut(start_ns=start, end_ns=end))
    return found


def read_cuts(file: Path) -> tuple[Cut, ...]:
    """Return the episodes of a CSV file; times are ns from the session's start, see ``shifted``.

    Its first line names the columns: start and end in seconds, and outcome if there are labels.

    Raises:
        UsageError: if it cannot be read, naming the line that is wrong.
    """
    return parsed_cuts(read_text(file), f"--cuts {file}")


def read_text(file: Path) -> str:
    """Return the content of a file of cuts.

    Raises:
        UsageError: if it cannot be read, or is too large.
    """
    try:
        with os.fdopen(open_regular(file, os.O_RDONLY), encoding="utf-8-sig", newline="") as stream:
            text = stream.read(_MOST_CHARACTERS + 1)
    except (OSError, UnicodeDecodeError) as error:
        raise UsageError(f"--cuts {file} cannot be read: {error}") from None
    if len(text) > _MOST_CHARACTERS:
        raise UsageError(f"--cuts {file} has more than {_MOST_CHARACTERS:,} characters")
    return text


def parsed_cuts(text: str, source: str) -> tuple[Cut, ...]:
    """Return the episodes of a text of CSV; see ``read_cuts``.

    Args:
        text: its content.
        source: where it comes from, for messages.

    Raises:
        UsageError: naming the line that is wrong.
    """
    try:
        head, *rows = list(csv.reader(text.splitlines())) or [[]]
    except csv.Error as error:
        raise UsageError(f"{source} cannot be read: {error}") from None
    if tuple(head) not in (_COLUMNS[:2], _COLUMNS):
        raise UsageError(f"{source}: line 1: got {shown(head)}, valid: {','.join(_COLUMNS)}")
    return tuple(_listed(source, number, row) for number, row in enumerate(rows, 2) if row)


def cuts_text(cuts: Sequence[Cut]) -> str:
    """Return the CSV of episodes whose times are ns from the session's start; times to 1 ms."""
    lines = [",".join(_COLUMNS)]
    lines += [f"{cut.start_ns / 1e9:.3f},{cut.end_ns / 1e9:.3f},{cut.outcome}" for cut in cuts]
    return "\n".join(lines) + "\n"


def shifted(cuts: Sequence[Cut], start_ns: int) -> tuple[Cut, ...]:
    """Return cuts relative to a session's start as times since the epoch."""
    return tuple(
        replace(cut, start_ns=cut.start_ns + start_ns, end_ns=cut.end_ns + start_ns) for cut in cuts
    )


def cut_of(start_s: float, end_s: float, outcome: str, source: str) -> Cut:
    """Return an episode of a list, in ns from the session's start.

    Args:
        start_s: its start, s from the session's start.
        end_s: its end.
        outcome: its name, or nothing.
        source: where it comes from, for messages.

    Raises:
        UsageError: if it cannot be one.
    """
    is_span = 0.0 <= start_s < end_s <= _LATEST_S and round(start_s * 1e9) < round(end_s * 1e9)
    if not (is_span and (not outcome or outcome in names(Outcome))):
        got = shown([start_s, end_s, outcome])
        raise UsageError(f"{source}: got {got}, valid: {_VALID}")
    return Cut(start_ns=round(start_s * 1e9), end_ns=round(end_s * 1e9), outcome=outcome)


def _listed(source: str, number: int, row: list[str]) -> Cut:
    where = f"{source}: line {number}"
    if len(row) > len(_COLUMNS):
        raise UsageError(f"{where}: got {shown(row)}, valid: {_VALID}")
    try:
        start, end = (float(word) for word in row[:2])
    except ValueError:
        raise UsageError(f"{where}: got {shown(row)}, valid: {_VALID}") from None
    return cut_of(start, end, row[2].strip() if len(row) > 2 else "", where)
