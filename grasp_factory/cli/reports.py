"""Results as text for people. Scripts take the same records as JSON."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

import yaml

from grasp_factory.checks.figure import Figure
from grasp_factory.collecting import Collected
from grasp_factory.collecting.provenance import SeedSource, stored_sources
from grasp_factory.dryrun import Forecast
from grasp_factory.factory import Plan, Summary
from grasp_factory.platforms import FINGERPRINT, fingerprint_of
from grasp_factory.relabel import Relabelled
from grasp_factory.replay import Replay
from grasp_factory.report_distance import distance_text
from grasp_factory.report_store import GROUPS, arrays_text, store_text
from grasp_factory.report_words import count, duration_text, percent, size_text, table
from grasp_factory.request import WHOLE
from grasp_factory.verifying import Repaired, Report
from grasp_factory.writers.header import SOURCES

__all__ = [
    "GROUPS",
    "arrays_text",
    "collected_text",
    "count",
    "duration_text",
    "figures_text",
    "forecast_text",
    "origin_text",
    "percent",
    "plan_text",
    "relabel_text",
    "repair_text",
    "replay_text",
    "size_text",
    "store_text",
    "summary_text",
    "table",
    "verify_text",
]

MOST_NAMED = 10
"""Quarantined episodes that a summary names."""
MOST_LINES = 50
"""Of a list, in text."""


def relabel_text(result: Relabelled) -> str:
    """Return one line on a new label."""
    return (
        f"labels/{result.name}: {result.successes} successes of"
        f" {count(result.episodes, 'episode')} ({result.successes_before} by the store's own"
        f" label), {count(result.changed, 'outcome')} changed"
    )


def figures_text(figures: Iterable[Figure]) -> str:
    """Return measured figures as a table beside their bounds."""
    head = ("check", "figure", "value", "bound", "samples", "")
    rows = [
        (f.check, f.figure, f"{f.value:.3g} {f.unit}", f.bound, f.samples,
         "ok" if f.passes else "MISSED")
        for f in figures
    ]  # fmt: skip
    return table([head, *rows], right=(2, 4))


def plan_text(plan: Plan) -> str:
    """Return one line on what a run is about to do."""
    there = plan.already_there
    if not plan.blocks and plan.shard == WHOLE:
        if there < plan.episodes:
            return f"{plan.path}: the {there} episodes asked for are there."
        return f"{plan.path} is complete: {there} episodes are there."
    if not plan.blocks:
        return f"Part {plan.shard} of {plan.path} is complete."
    part = "" if plan.shard == WHOLE else f", part {plan.shard}"
    config = plan.config
    rest = f", {there} are there" if there and plan.shard == WHOLE else ""
    width, height = config.resolution
    return (
        f"Making {count(plan.to_make, 'episode')} of {config.robot} at {width}x{height},"
        f" seed {config.seed}, with {count(plan.workers, 'worker')} into {plan.path}{rest}{part}."
    )


def summary_text(summary: Summary) -> str:
    """Return a run's summary as a small table."""
    speed = ""
    if summary.episodes_per_second is not None:
        speed = f" in {summary.seconds:.1f} s ({summary.episodes_per_second:.2f} episodes/s)"
    there = f"{summary.already_there} were there" if summary.already_there else ""
    head = ", ".join(filter(None, [f"{count(summary.made, 'episode')} made{speed}", there]))
    text = [head, store_text(summary.store, ("policy", "outcome"))]
    if summary.quarantined:
        named = [f"episode {i} is quarantined: {why}" for i, why in summary.quarantined.items()]
        rest = len(named) - MOST_NAMED
        text.append("\n".join([*named[:MOST_NAMED], *([f"and {rest} more"] if rest > 0 else [])]))
    return "\n\n".join(text)


def origin_text(attributes: Mapping[str, Any]) -> str:
    """Return what a store was made with, and from which config."""
    facts = {**attributes["versions"], **attributes["platform"]}
    if known := fingerprint_of(attributes):
        facts[FINGERPRINT] = str(known)
    config = {"sha256": attributes["config_sha256"], **attributes["config"]}
    text = yaml.safe_dump(config, sort_keys=False, default_flow_style=None, width=88)
    parts = [table([("made with", ""), *facts.items()])]
    if SOURCES in attributes:
        parts.append("\n".join(["put together from", *_sources_lines(stored_sources(attributes))]))
    return "\n\n".join([*parts, f"config\n{text}"]).rstrip()


def collected_text(result: Collected) -> str:
    """Return what came of a merge or a split."""
    head = f"{result.path}: {count(result.committed, 'episode')}, all read back and compared"
    if result.repeated:
        head += f"; {count(result.repeated, 'row')} that several stores have went in once"
    lines = [head, *_sources_lines(result.sources)]
    if result.quarantined:
        lines.append(f"{result.quarantined} of {result.rows} rows are quarantined")
    if result.missing:
        lines.append(f"{result.missing} of {result.rows} are missing: run generate on it")
    lines += [f"labels/{name} was carried over" for name in result.labels]
    lines += [f"labels/{n} was left out: {why}" for n, why in result.labels_left_out.items()]
    if result.annotations:
        lines.append(f"annotations of {count(result.annotations, 'episode')} were carried over")
    return "\n".join([*lines, *(f"warning: {warning}" for warning in result.warnings)])


def _sources_lines(sources: Iterable[SeedSource]) -> list[str]:
    rows = [
        (source.seed, source.rows, ", ".join(dict.fromkeys(
            f"grasp_factory {maker.versions.get('grasp_factory', '?')}"
            f" on {maker.platform.get('cpu', '?')}" for maker in source.made_with
        )))
        for source in sources
    ]  # fmt: skip
    return table([("seed", "rows", "made with"), *rows], right=(0, 1)).splitlines()


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


def forecast_text(found: Forecast) -> str:
    """Return what a run would take as a table."""
    head = f"{count(found.to_make, 'episode')} to make, {found.already_there} are there"
    expected = found.expected
    if expected is None:
        return f"{head}: {found.path} is complete."
    low, high = expected.success_interval or (None, None)
    rows = [
        ("time", duration_text(expected.seconds), f"with {count(found.workers, 'worker')}"),
        ("speed", f"{found.to_make / expected.seconds:.2f} episodes/s", ""),
        ("disk", size_text(expected.bytes), f"of {size_text(found.free_bytes)} that are free"),
        ("memory", size_text(expected.peak_bytes), "at the peak, all workers"),
        ("success", percent(expected.success_rate), f"95 %: {percent(low)} to {percent(high)}"),
    ]
    if expected.quarantined:
        rows.append(("quarantined", str(expected.quarantined), "of the pilots"))
    pilots = f"from {count(expected.pilots, 'pilot')}, of which nothing is kept"
    lines = [f"{head}; {pilots}:", table(rows)]
    if not found.fits:
        lines.append(f"warning: the disk of {found.path} has no room for it")
    return "\n".join(lines)


def verify_text(found: Report) -> str:
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


def repair_text(result: Repaired) -> str:
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
