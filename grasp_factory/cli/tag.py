"""The commands for what people say of episodes: saying it, and listing it."""

# ruff: noqa: PLC0415

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, TextIO

import click

from grasp_factory.cli.params import AS_JSON, IDS, STORE, indices, print_json
from grasp_factory.errors import UsageError, shown

if TYPE_CHECKING:
    from grasp_factory.dataset.annotations import Annotation, Change

NONE = "none"
"""Word that takes a quality or an outcome back."""
LONGEST_LINE = 80
"""Of a change, in a table."""
EPISODES = click.option("--episodes", metavar="I,J,...", help="These rows.")


@click.command()
@STORE
@EPISODES
@IDS
@click.option("--add", metavar="TAG", multiple=True, help="Add a tag. Repeatable.")
@click.option("--remove", metavar="TAG", multiple=True, help="Remove a tag. Repeatable.")
@click.option("--note", metavar="TEXT", help="Set the note; an empty one clears it.")
@click.option("--quality", metavar="1..5|none", help="Set the quality, 5 is best; none clears it.")
@click.option("--outcome", metavar="WORD|none", help="Correct the label; none clears that.")
@click.option("--who", metavar="NAME", help="Who says so.  [default: $GRASP_FACTORY_USER or you]")
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
    """Say something of episodes: tags, a note, their quality, the right outcome.

    It is kept in the store at PATH with who said it and when, apart from what was measured, and
    stays when the store grows, is repaired, merged or split. `grasp-factory tags` lists it.
    """
    from grasp_factory.core.text_format import count
    from grasp_factory.dataset.annotations import AnnotationLog, default_who

    for word in sorted({*add}.intersection(remove)):
        raise UsageError(f"--add and --remove both say {shown(word)}: choose one of them")
    changes: list[tuple[str, Any]] = [("tag", text) for text in add]
    changes += [("untag", text) for text in remove]
    if note is not None:
        changes.append(("note", note))
    if quality is not None:
        changes.append(("quality", _quality(quality)))
    if outcome is not None:
        changes.append(("outcome", None if outcome == NONE else outcome))
    rows = _rows(path, episodes, ids)
    if not rows:
        raise UsageError("no episodes are chosen: name them with --episodes or --ids")
    person = default_who() if who is None else who
    found = AnnotationLog(path).append(person, rows, changes)
    if as_json:
        print_json([{"row": row, "annotation": said} for row, said in found.items()])
    else:
        click.echo(f"{path}: {count(len(found), 'episode')} annotated by {person}")


@click.command()
@STORE
@EPISODES
@IDS
@click.option("--history", is_flag=True, help="Every change, with who made it and when.")
@click.option("--csv", "as_csv", is_flag=True, help="Print CSV for spreadsheets.")
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
    """List what people have said of the episodes of a store.

    Prints the tags of the store at PATH with how many episodes have them; with --json or --csv all
    annotations, episode by episode, and with --history every change that led there.
    """
    from grasp_factory.dataset.annotations import AnnotationLog
    from grasp_factory.dataset.annotations.listing import annotations_csv, changes_csv
    from grasp_factory.writers.zarr.header import read_attributes

    if as_csv and as_json:
        raise UsageError("--csv and --json: choose one of them")
    read_attributes(path)
    log, rows = AnnotationLog(path), _rows(path, episodes, ids)
    chosen = None if rows is None else set(rows)
    said = [found for row, found in sorted(log.annotations().items()) if _is_in(chosen, row)]
    changes = [change for change in log.changes() if _is_in(chosen, change.row)]
    if as_json:
        print_json(changes if history else said)
    elif as_csv:
        click.echo(changes_csv(changes) if history else annotations_csv(said), nl=False)
    else:
        nothing = "no annotations: grasp-factory tag makes them"
        if chosen is not None and log.annotations():
            nothing = "no annotations of these episodes"
        click.echo((_history_text(changes) if history else _text(said)) or nothing)
    for line, fault in log.damaged():
        click.echo(f"warning: annotations/log.jsonl, line {line} {fault}", err=True)


def _rows(path: Path, episodes: str | None, ids: TextIO | None) -> list[int] | None:
    """Return the rows that every option names; None if there are no options."""
    given = [] if episodes is None else [indices(episodes)]
    if ids is not None:
        from grasp_factory.dataset.selection import read_selection

        given.append(read_selection(ids, path))
    if not given:
        return None
    return sorted(set(given[0]).intersection(*given[1:]))


def _is_in(chosen: set[int] | None, row: int) -> bool:
    return chosen is None or row in chosen


def _quality(text: str) -> int | str | None:
    """Return the number that a text is, or the text, which is then refused."""
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
        short = text if len(text) <= LONGEST_LINE else f"{text[: LONGEST_LINE - 3]}..."
        rows.append((change.when, change.who, change.row, change.kind, short))
    return table([("when", "who", "row", "change", "value"), *rows], right=(2,))
