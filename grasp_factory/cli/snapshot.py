"""The commands of versions: ``snapshot``, ``log`` and ``diff``."""

# ruff: noqa: PLC0415

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from grasp_factory.cli.params import AS_JSON, STORE, Command, option
from grasp_factory.cli.printing import print_json, say, say_lines

if TYPE_CHECKING:
    from grasp_factory.curation.versions import Difference
    from grasp_factory.dataset.snapshots import Snapshot


@click.command(
    cls=Command,
    examples=(
        "grasp-factory snapshot grasps.zarr -m 'first 500 episodes'",
        "grasp-factory verify grasps.zarr --snapshot 3fa9c1",
    ),
)
@STORE
@option("-m", "--message", metavar="TEXT", required=True, help="What this version is.")
@option(
    "--who",
    metavar="NAME",
    default="",
    help="Name of the author.  [default: $GRASP_FACTORY_USER, or your user name]",
)
@AS_JSON
def snapshot(path: Path, *, message: str, who: str, as_json: bool) -> None:
    """Record a version of a store.

    Writes the checksums of all rows of the store at PATH, its config and its annotations' hash to a
    small file in PATH.snapshots. The store itself stays as it is. The id of a snapshot is a hash of
    its content; other commands take the first digits. Nothing is written if the newest snapshot is
    the same.
    """
    from grasp_factory.core.text_format import count, size_text
    from grasp_factory.curation.versions import take_snapshot
    from grasp_factory.dataset.snapshots.snapshot_folder import SHORT

    taken = take_snapshot(path, message, who=who)
    if as_json:
        print_json(taken)
        return
    rows = count(taken.committed, "episode")
    if taken.quarantined:
        rows += f", {taken.quarantined} quarantined"
    if not taken.is_new:
        say(f"{path}: unchanged since snapshot {taken.id[:SHORT]} ({rows})")
        return
    say(f"{path}: snapshot {taken.id[:SHORT]}: {rows}; {size_text(taken.bytes_written)} written")


@click.command(
    cls=Command,
    examples=("grasp-factory log grasps.zarr", "grasp-factory log grasps.zarr --json"),
)
@STORE
@AS_JSON
def log(path: Path, *, as_json: bool) -> None:
    """List the snapshots of a store.

    The newest is first. The store at PATH itself need not be there: its snapshots are in
    PATH.snapshots.
    """
    from grasp_factory.core.text_format import table
    from grasp_factory.dataset.snapshots import SnapshotFolder

    history = SnapshotFolder.of(path).history()
    if as_json:
        print_json([_log_entry(name, found) for name, found in history])
        return
    if not history:
        say(f"{path} has no snapshots: `grasp-factory snapshot {path} -m TEXT` takes one")
        return
    known = dict(history)
    rows = [_log_row(name, found, known) for name, found in history]
    say(table([("snapshot", "taken", "by", "episodes", "", "message"), *rows], right=(3, 4)))


@click.command(
    cls=Command,
    examples=(
        "grasp-factory diff grasps.zarr@3fa9c1 grasps.zarr",
        "grasp-factory diff grasps.zarr@3fa9c1 grasps.zarr@77ab02 --arrays --ids",
        "grasp-factory diff before.zarr after.zarr --json",
    ),
)
@click.argument("a")
@click.argument("b")
@option("--arrays", is_flag=True, help="Also count which arrays differ in the changed episodes.")
@option("--ids", is_flag=True, help="Also list the episodes.")
@AS_JSON
def diff(a: str, b: str, *, arrays: bool, ids: bool, as_json: bool) -> None:
    """Compare two versions of a store.

    A and B are stores, versions as in STORE@ID, or files of snapshots. Prints how many episodes
    were added, removed and changed from A to B, and which settings, labels and annotations differ.
    An episode is known by seed and index of its recipe.
    """
    from grasp_factory.curation.versions import compare
    from grasp_factory.dataset.snapshots import open_version

    found = compare(open_version(a), open_version(b), arrays=arrays)
    if as_json:
        print_json(found.to_plain(ids=ids))
        return
    say_lines(_diff_lines(found))
    if ids:
        _say_ids(found)


def _log_entry(name: str, found: Snapshot) -> dict[str, Any]:
    contents = found.contents
    return {
        "id": name,
        "parent": found.parent,
        "created": found.created,
        "who": found.who,
        "message": found.message,
        "episodes": contents.committed,
        "quarantined": contents.quarantined,
        "rows": contents.rows,
        "contents_sha256": contents.sha256,
        "config_sha256": contents.attributes.get("config_sha256"),
        "revision": found.revision,
        "command": found.command,
        "grasp_factory": found.grasp_factory,
    }


def _log_row(name: str, found: Snapshot, known: dict[str, Snapshot]) -> tuple[object, ...]:
    from grasp_factory.dataset.snapshots.snapshot_folder import SHORT

    episodes = found.contents.committed
    before = known.get(found.parent or "")
    more = f"{episodes - before.contents.committed:+d}" if before else ""
    taken = found.created[:16].replace("T", " ")
    return (name[:SHORT], taken, found.who, episodes, more, found.message.splitlines()[0])


def _diff_lines(found: Difference) -> list[str]:
    if found.is_empty:
        return [f"{found.a} and {found.b} are the same: {found.unchanged} episodes"]
    words = ("added", "removed", "changed")
    counts = ", ".join(f"{len(getattr(found, word))} {word}" for word in words)
    lines = [f"from {found.a} to {found.b}: {counts}, {found.unchanged} unchanged"]
    if found.arrays is not None:
        lines += [f"  {path}: differs in {n}" for path, n in found.arrays.items()]
    lines += [f"labels/{name}: {word}" for name, word in found.labels.items()]
    if found.annotations:
        lines.append(f"annotations: {found.annotations}")
    return [*lines, *found.settings]


def _say_ids(found: Difference) -> None:
    from grasp_factory.core.text_format import table

    rows = list(found.rows())
    if rows:
        say(table([("episode", "row", "seed", "index"), *rows], right=(1, 2, 3)))
