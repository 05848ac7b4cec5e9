"""The commands that annotate episodes and list the annotations: ``tag`` and ``tags``."""

# ruff: noqa: PLC0415

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, TextIO

import click

from grasp_factory.cli.params import AS_JSON, STORE, Command, option
from grasp_factory.cli.printing import print_json, say
from grasp_factory.cli.row_choice import list_options, listed_rows
from grasp_factory.errors import UsageError, shown

if TYPE_CHECKING:
    from grasp_factory.dataset.annotations import Annotation, Change

NONE = "none"
"""The word that removes a quality score or a corrected label."""
LONGEST_CHANGE = 80
"""Characters of a change in the table of --history."""

_annotation = partial(option, heading="Annotation")


@click.command(
    cls=Command,
    examples=(
        "grasp-factory tag grasps.zarr --episodes 3,17 --add odd --note 'slips late'",
        "grasp-factory tag grasps.zarr --episodes 17 --quality 2 --outcome lost_in_lift",
        "grasp-factory query grasps.zarr --where 'slip_distance>0.02' --ids > ids.txt",
        "grasp-factory tag grasps.zarr --ids ids.txt --add slipped",
    ),
)
@STORE
@list_options
@_annotation("--add", metavar="TAG", multiple=True, help="Add a tag. Repeatable.")
@_annotation("--remove", metavar="TAG", multiple=True, help="Remove a tag. Repeatable.")
@_annotation("--note", metavar="TEXT", help="Set the note; an empty text removes it.")
@_annotation(
    "--quality",
    metavar="1..5|none",
    help="Set the quality score, where 5 is the best; none removes it.",
)
@_annotation(
    "--outcome", metavar="WORD|none", help="Correct the label; none removes the correction."
)
@_annotation(
    "--who",
    metavar="NAME",
    help="Name of the annotator.  [default: $GRASP_FACTORY_USER, or your user name]",
)
@AS_JSON
def tag(
    path: Path,
    *,
    episodes: str | None,
    ids: TextIO | None,
    add: tuple[str, ...],
    remove: tuple[str, ...],
    note: str | None,
    quality: str | None,
    outcome: str | None,
    who: str | None,
    as_json: bool,
) -> None:
    """Add tags, notes, scores or corrected labels to episodes.

    Annotations are kept in the store at PATH with author and time, apart from the measured data.
    They stay when the store grows or is repaired, merged or split. `grasp-factory tags` lists them.
    """
    from grasp_factory.core.text_format import count
    from grasp_factory.dataset.annotations import AnnotationLog, default_who

    for word in sorted({*add}.intersection(remove)):
        raise UsageError(f"--add and --remove both name {shown(word)}: choose one of them")
    changes: list[tuple[str, Any]] = [("tag", text) for text in add]
    changes += [("untag", text) for text in remove]
    if note is not None:
        changes.append(("note", note))
    if quality is not None:
        changes.append(("quality", _quality(quality)))
    if outcome is not None:
        changes.append(("outcome", None if outcome == NONE else outcome))
    rows = listed_rows(path, episodes, ids)
    if not rows:
        raise UsageError("no episodes are chosen: name them with --episodes or --ids")
    person = default_who() if who is None else who
    found = AnnotationLog(path).append(person, sorted(set(rows)), changes)
    if as_json:
        print_json([{"row": row, "annotation": said} for row, said in found.items()])
    else:
        say(f"{path}: {count(len(found), 'episode')} annotated by {person}")


@click.command(
    cls=Command,
    examples=(
        "grasp-factory tags grasps.zarr",
        "grasp-factory tags grasps.zarr --csv > annotations.csv",
        "grasp-factory tags grasps.zarr --episodes 17 --history",
    ),
)
@STORE
@list_options
@option("--history", is_flag=True, help="Print every change with author and time.")
@option("--csv", "as_csv", is_flag=True, help="Print CSV.")
@AS_JSON
def tags(
    path: Path,
    *,
    episodes: str | None,
    ids: TextIO | None,
    history: bool,
    as_csv: bool,
    as_json: bool,
) -> None:
    """List the annotations of a store.

    Prints each tag of the store at PATH with its number of episodes. With --json or --csv, prints
    the annotations of each episode. With --history, prints every change.
    """
    from grasp_factory.dataset.annotations import AnnotationLog
    from grasp_factory.dataset.annotations.listing import annotations_csv, changes_csv
    from grasp_factory.writers.zarr.header import read_attributes

    if as_csv and as_json:
        raise UsageError("--csv and --json: choose one of them")
    read_attributes(path)
    log, rows = AnnotationLog(path), listed_rows(path, episodes, ids)
    chosen = None if rows is None else set(rows)
    said = [found for row, found in sorted(log.annotations().items()) if _is_in(chosen, row)]
    changes = [change for change in log.changes() if _is_in(chosen, change.row)]
    if as_json:
        print_json(changes if history else said)
    elif as_csv:
        say(changes_csv(changes) if history else annotations_csv(said), end="")
    else:
        nothing = "no annotations; `grasp-factory tag` adds them"
        if chosen is not None and log.annotations():
            nothing = "no annotations of these episodes"
        say((_history_text(changes) if history else _text(said)) or nothing)
    for line, fault in log.damaged():
        say(f"warning: annotations/log.jsonl, line {line} {fault}", err=True)


def _is_in(chosen: set[int] | None, row: int) -> bool:
    return chosen is None or row in chosen


def _quality(text: str) -> int | str | None:
    """Return the number in a text, or the text itself, which the log refuses."""
    if text == NONE:
        return None
    return int(text) if text.isascii() and text.isdecimal() and len(text) < 9 else text


def _text(annotations: Sequence[Annotation]) -> str:
    from grasp_factory.core.text_format import count, table
    from grasp_factory.dataset.annotations.listing import summary, tag_counts

    found = summary(annotations)
    total = found.pop("annotated")
    if not total:
        return ""
    rows = [("tag", "episodes"), *tag_counts(annotations).items()]
    lines = [table(rows, right=(1,))] if len(rows) > 1 else []
    words = ", ".join(f"{number} {what}" for what, number in found.items() if number)
    return "\n".join([*lines, f"{count(total, 'episode')} annotated: {words}"])


def _history_text(changes: Sequence[Change]) -> str:
    from grasp_factory.core.text_format import table
    from grasp_factory.dataset.annotations.listing import change_text

    if not changes:
        return ""
    rows = []
    for change in changes:
        text = change_text(change)
        short = text if len(text) <= LONGEST_CHANGE else f"{text[: LONGEST_CHANGE - 3]}..."
        rows.append((change.when, change.who, change.row, change.kind, short))
    return table([("when", "who", "row", "change", "value"), *rows], right=(2,))
