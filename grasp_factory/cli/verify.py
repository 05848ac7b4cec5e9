"""The command ``verify``: check a store for damage."""

# ruff: noqa: PLC0415

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING

import click

from grasp_factory.cli.params import AS_JSON, STORE, Command, option, options
from grasp_factory.cli.plugin_options import allow_plugins, plugin_options
from grasp_factory.cli.printing import print_json, say
from grasp_factory.core.serialization import to_plain
from grasp_factory.core.text_format import count, joined_lines

if TYPE_CHECKING:
    from grasp_factory.curation.verify import VerifyReport

MOST_LINES = 50
"""Lines of a list in a text."""
WORKERS = option(
    "--workers",
    metavar="N",
    type=int,
    default=2,
    show_default=True,
    help="Worker processes; 1 works without worker processes.",
)


@click.command(
    cls=Command,
    examples=(
        "grasp-factory verify grasps.zarr",
        "grasp-factory verify grasps.zarr --deep 20 --deep-seed 0",
        "grasp-factory verify grasps.zarr --signed-by id_ed25519.pub",
        "grasp-factory verify grasps.zarr --snapshot 3fa9c1",
        "grasp-factory verify grasps.zarr --workers 4 --json",
    ),
)
@STORE
@option(
    "--deep",
    type=int,
    default=0,
    show_default=True,
    metavar="N",
    help="Also simulate N episodes again and compare the bytes.",
)
@option(
    "--deep-seed",
    metavar="SEED",
    type=int,
    help="Seed of the choice of these episodes.  [default: a new one each time]",
)
@option(
    "--signed-by",
    metavar="FILE",
    type=click.Path(path_type=Path),
    help="Also check that the owner of this public SSH key has signed every file.",
)
@option(
    "--snapshot",
    "snapshot_id",
    metavar="ID",
    help="Also check that all rows are as in this snapshot; the first digits are enough.",
)
@options(*plugin_options())
@WORKERS
@AS_JSON
@click.pass_context
def verify(
    ctx: click.Context,
    path: Path,
    *,
    deep: int,
    deep_seed: int | None,
    signed_by: Path | None,
    snapshot_id: str | None,
    plugins: tuple[Path, ...],
    trust: bool,
    workers: int,
    as_json: bool,
) -> None:
    """Check a store for damaged or missing data.

    Checks the structure of the store at PATH, the checksums of every episode, and the rules that
    its arrays must follow. Changes nothing. Exits with 0 if there is no problem, and with 1 after
    it has listed all problems.
    """
    from grasp_factory.cli.bars import counted
    from grasp_factory.curation.signing import check_signature
    from grasp_factory.curation.verify import verify as run
    from grasp_factory.curation.versions import check_snapshot

    if deep:
        allow_plugins(path, plugins, trust=trust)
    with counted("on_episode") as hooks:
        report = run(path, deep, workers, deep_seed=deep_seed, **hooks)
    if signed_by is not None:
        with counted("on_file", "file") as hooks:
            report = report.with_signature(check_signature(path, signed_by, **hooks), signed_by)
    if snapshot_id is not None:
        report = report.with_snapshot(check_snapshot(path, snapshot_id))
    if as_json:
        print_json(to_plain(report) | {"is_whole": report.is_whole})
    else:
        say(_verify_text(report))
    ctx.exit(0 if report.is_whole else 1)


def _verify_text(found: VerifyReport) -> str:
    """Return the counts of a store, then a line for each problem and note."""
    parts = (f"{n} {word}" for word in ("quarantined", "missing") if (n := getattr(found, word)))
    rows = ", ".join([count(found.committed, "episode"), *parts])
    lines = [f"{found.path}: {rows}"]
    if found.deep_seed is not None:
        drawn = (
            ", ".join(map(str, found.simulated))
            or "none, because no simulated episode is undamaged"
        )
        lines.append(f"simulated again: {drawn} (--deep-seed {found.deep_seed})")
    if found.changed:
        lines += change_lines(found.changed)
    lines += [f"note: {note}" for note in found.notes]
    if found.is_whole:
        return joined_lines([*lines, "no problems found"])
    lines.append(f"{count(len(found.problems), 'problem')}:")
    return joined_lines([*lines, *first_lines(found.problems)])


def change_lines(changes: Iterable[str]) -> list[str]:
    """Return the lines that name versions and platform facts which changed."""
    return ["changed since the store was made:", *(f"  {change}" for change in changes)]


def first_lines(items: Iterable[object]) -> list[str]:
    """Return a line for each of the first items, and one with the number of the others."""
    lines = [f"  {item}" for item in items]
    more = len(lines) - MOST_LINES
    return lines if more <= 0 else [*lines[:MOST_LINES], f"  and {more} more (--json lists all)"]
