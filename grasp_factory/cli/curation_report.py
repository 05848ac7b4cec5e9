"""What came of checking or changing a store, as text for people."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

from grasp_factory.cli.distance_report import distance_text
from grasp_factory.cli.store_report import sources_lines
from grasp_factory.core.text_format import count
from grasp_factory.curation.merge import Collected
from grasp_factory.curation.relabel import Relabelled
from grasp_factory.curation.verify import VerifyReport

if TYPE_CHECKING:  # these load the simulator
    from grasp_factory.curation.repair import RepairReport
    from grasp_factory.curation.replay import Replay

MOST_LINES = 50
"""Of a list, in text."""


def relabel_text(result: Relabelled) -> str:
    """Return one line on a new label."""
    return (
        f"labels/{result.name}: {result.successes} successes of"
        f" {count(result.episodes, 'episode')} ({result.successes_before} by the store's own"
        f" label), {count(result.changed, 'outcome')} changed"
    )


def collected_text(result: Collected) -> str:
    """Return what came of a merge or a split."""
    head = f"{result.path}: {count(result.committed, 'episode')}, all read back and compared"
    if result.repeated:
        head += f"; {count(result.repeated, 'row')} that several stores have went in once"
    lines = [head, *sources_lines(result.sources)]
    if result.quarantined:
        lines.append(f"{result.quarantined} of {result.rows} rows are quarantined")
    if result.missing:
        lines.append(f"{result.missing} of {result.rows} are missing: run generate on it")
    lines += [f"labels/{name} was carried over" for name in result.labels]
    lines += [f"labels/{n} was left out: {why}" for n, why in result.labels_left_out.items()]
    if result.annotations:
        lines.append(f"annotations of {count(result.annotations, 'episode')} were carried over")
    return "\n".join([*lines, *(f"warning: {warning}" for warning in result.warnings)])


def replay_text(result: Replay) -> str:
    """Return what came of a replay."""
    word = f"episode {result.index} ({result.recorded})"
    if result.same:
        lines = [f"{word} replays to the same bytes"]
    else:
        lines = [f"{word} does not replay to the same bytes"]
        if result.recorded != result.replayed:
            lines.append(
                f"outcome: {result.recorded} was recorded, the replay gives {result.replayed}"
            )
        lines.append(f"first difference: {result.difference or 'the reason of the quarantine'}")
    if result.distance is not None:
        lines += distance_text(result.distance).splitlines()
    if result.platform:
        lines.append(f"platform: {result.platform}")
    if result.changed:
        lines += ["not as when it was recorded:", *(f"  {change}" for change in result.changed)]
    return "\n".join(lines)


def verify_text(found: VerifyReport) -> str:
    """Return what verifying found: counts, then a line for each problem and note."""
    parts = (f"{n} {word}" for word in ("quarantined", "missing") if (n := getattr(found, word)))
    rows = ", ".join([count(found.committed, "episode"), *parts])
    lines = [f"{found.path}: {rows}"]
    if found.deep_seed is not None:
        drawn = ", ".join(map(str, found.simulated)) or "none, for none is whole"
        lines.append(f"simulated again: {drawn} (--deep-seed {found.deep_seed})")
    if found.changed:
        lines += ["not as when it was made:", *(f"  {change}" for change in found.changed)]
    lines += [f"note: {note}" for note in found.notes]
    if found.is_whole:
        return "\n".join([*lines, "all is as it was written"])
    lines.append(f"{count(len(found.problems), 'problem')}:")
    return "\n".join([*lines, *_first(found.problems)])


def repair_text(result: RepairReport) -> str:
    """Return what a repair found, did and left."""
    if not result.before.problems and not result.mended:
        return f"{result.before.path} is whole: there is nothing to repair"
    lines = [f"{result.before.path}: {count(len(result.before.problems), 'problem')} found"]
    lines += _first(result.mended)
    words = {True: "the same again", False: "DIFFERENT from what was there", None: "made anew"}
    for is_same, word in words.items():
        rows = [made.episode for made in result.remade if made.is_same is is_same]
        if rows:
            named = ", ".join([*map(str, rows[:MOST_LINES]), *["..."][: len(rows) - MOST_LINES]])
            lines.append(f"{count(len(rows), 'episode')} simulated, {word}: {named}")
    if result.remade and result.before.changed:
        changes = [f"  {change}" for change in result.before.changed]
        lines += ["not as when the store was made:", *changes]
    lines += [f"failed: {failure}" for failure in result.failed]
    if result.is_whole:
        return "\n".join([*lines, "the store is whole"])
    left = count(len(result.after.problems), "problem")
    return "\n".join([*lines, f"{left} left:", *_first(result.after.problems)])


def _first(items: Iterable[object]) -> list[str]:
    """Return a line for each of the first items, and one that counts the others."""
    lines = [f"  {item}" for item in items]
    more = len(lines) - MOST_LINES
    return lines if more <= 0 else [*lines[:MOST_LINES], f"  and {more} more: --json has them all"]
