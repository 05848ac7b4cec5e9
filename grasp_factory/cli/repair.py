"""The command ``repair``: restore damaged or missing data of a store."""

# ruff: noqa: PLC0415

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from grasp_factory.cli.params import AS_JSON, STORE, Command, option, options
from grasp_factory.cli.plugin_options import allow_plugins, plugin_options
from grasp_factory.cli.printing import print_json, say
from grasp_factory.cli.verify import MOST_LINES, WORKERS, change_lines, first_lines
from grasp_factory.core.platforms import ACCEPT
from grasp_factory.core.serialization import to_plain
from grasp_factory.core.text_format import count, joined_lines

if TYPE_CHECKING:
    from grasp_factory.curation.repair import RepairReport


@click.command(
    cls=Command,
    examples=(
        "grasp-factory repair grasps.zarr",
        "grasp-factory repair grasps.zarr --workers 4 --json",
    ),
)
@STORE
@WORKERS
@option(
    ACCEPT,
    is_flag=True,
    help="Also simulate episodes that were made on another platform, where bytes may differ.",
)
@options(*plugin_options())
@AS_JSON
@click.pass_context
def repair(
    ctx: click.Context,
    path: Path,
    *,
    workers: int,
    accept_other_platform: bool,
    plugins: tuple[Path, ...],
    trust: bool,
    as_json: bool,
) -> None:
    """Restore damaged or missing data of a store.

    Runs `verify` on the store at PATH and makes what is damaged or missing again, from the stored
    config and recipes. Undamaged episodes stay as they are. Exits with 0 if no problem is left.
    """
    from grasp_factory.cli.bars import counted
    from grasp_factory.curation.repair import repair as run

    allow_plugins(path, plugins, trust=trust)
    with counted("on_episode") as hooks:
        result = run(path, workers, accept_other_platform=accept_other_platform, **hooks)
    if as_json:
        more = {"is_whole": result.is_whole}
        remade = [to_plain(made) | {"is_same": made.is_same} for made in result.remade]
        print_json(to_plain(result) | {"remade": remade} | more)
    else:
        say(_repair_text(result))
    ctx.exit(0 if result.is_whole else 1)


def _repair_text(result: RepairReport) -> str:
    """Return what a repair found, what it did and what is left."""
    if not result.before.problems and not result.mended:
        return f"{result.before.path}: no problems found, nothing to repair"
    lines = [f"{result.before.path}: {count(len(result.before.problems), 'problem')} found"]
    lines += first_lines(result.mended)
    words = {
        True: "with the same bytes as before",
        False: "with DIFFERENT bytes than before",
        None: "without bytes to compare",
    }
    for is_same, word in words.items():
        rows = [made.episode for made in result.remade if made.is_same is is_same]
        if rows:
            named = ", ".join([*map(str, rows[:MOST_LINES]), *["..."][: len(rows) - MOST_LINES]])
            lines.append(f"{count(len(rows), 'episode')} simulated again {word}: {named}")
    if result.remade and result.before.changed:
        lines += change_lines(result.before.changed)
    lines += [f"failed: {failure}" for failure in result.failed]
    if result.is_whole:
        return joined_lines([*lines, "no problems left"])
    left = count(len(result.after.problems), "problem")
    return joined_lines([*lines, f"{left} left:", *first_lines(result.after.problems)])
