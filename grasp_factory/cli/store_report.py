"""Texts about the contents of a store."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

import yaml

from grasp_factory.core.platforms import FINGERPRINT, fingerprint_of
from grasp_factory.core.text_format import (
    bar,
    count,
    joined_lines,
    named_lines,
    percent,
    size_text,
    table,
)
from grasp_factory.curation.merge.provenance import SeedSource, stored_sources
from grasp_factory.dataset.summary import StoreSummary, Tally
from grasp_factory.writers.zarr.header import SOURCES
from grasp_factory.writers.zarr.made_of_export import import_note

GROUPS = ("policy", "outcome", "object family", "object set", "split", "tag")
"""Tables of a store by their keys."""
MOST_ROWS = 20
"""Object families and tags that a table lists."""
SCREEN = 80
"""Characters of a line of the short text."""
BAR = 40
"""Characters of a bar that stands for all episodes."""


def store_text(store: StoreSummary, groups: Iterable[str]) -> str:
    """Return a store's counts and tables.

    Args:
        store: Its summary.
        groups: Keys of ``GROUPS``, in order. Tables without data are left out.
    """
    head = [
        f"{store.path}: {count(store.committed, 'episode')}, {percent(store.success_rate)} success,"
        f" {size_text(store.bytes)}"
    ]
    if store.bytes_per_episode:
        head[0] += f" ({size_text(store.bytes_per_episode)} each)"
    if store.missing:
        what = f"{store.missing} of {store.episodes} episodes are missing"
        head.append(f"{what}: run `grasp-factory generate` again")
    if store.quarantined:
        head.append(f"{store.quarantined} of {store.episodes} episodes are quarantined")
    if store.quality:
        scores = ", ".join(f"{n} with {score}" for score, n in store.quality.items())
        head.append(f"quality scores, 5 is the best: {scores}")
    if store.annotated:
        corrected = f", {store.corrected} with a corrected label" if store.corrected else ""
        head.append(f"{count(store.annotated, 'row')} annotated by people{corrected}")
    if len(store.platforms) > 1:
        head.append(f"made on {len(store.platforms)} platforms, with these fingerprints:")
        head += [f"  {count(n, 'row')} on {known}" for known, n in store.platforms.items()]
    tables = {
        "policy": _tally_table("policy", store.policies),
        "outcome": _outcome_table(store),
        "object family": _family_table(store),
        "object set": _tally_table("object set", store.object_sets),
        "split": _tally_table("split", store.splits),
        "tag": _tag_table(store.tags),
    }
    return "\n\n".join([joined_lines(head), *(tables[g] for g in groups if tables[g])])


def stores_table(stores: Iterable[StoreSummary]) -> str:
    """Return the counts of several stores, one in each line."""
    rows = [
        (s.path, str(s.committed), str(s.missing), str(s.quarantined), percent(s.success_rate),
         size_text(s.bytes)) for s in stores
    ]  # fmt: skip
    head = ("store", "episodes", "missing", "quarantined", "success", "size")
    return table([head, *rows], range(1, len(head)))


def short_text(store: StoreSummary) -> str:
    """Return a store's counts on one screen: the outcomes as a table, the others in a few lines."""
    groups = {
        "policy": store.policies,
        "family": dict(sorted(store.families.items(), key=lambda item: -item[1].episodes)),
        "split": store.splits,
    }
    parts = [
        (
            name,
            ", ".join(f"{key} {t.episodes} ({percent(t.success_rate)})" for key, t in by.items()),
        )
        for name, by in groups.items()
    ]
    tags = ", ".join(f"{tag} {rows}" for tag, rows in store.tags.items())
    lines = named_lines([*parts, ("tags", tags)], SCREEN, 2)
    note = "In brackets: success. `info --full`: all tables, arrays, versions, config."
    return "\n\n".join(filter(None, [store_text(store, ["outcome"]), "\n".join(lines), note]))


def arrays_text(facts: Iterable[Mapping[str, Any]]) -> str:
    """Return the arrays of a store as a table."""
    rows = [
        (f["path"], " x ".join(map(str, f["shape"])), f["dtype"], f["units"] or "-") for f in facts
    ]
    return table([("array", "shape", "dtype", "unit"), *rows])


def origin_text(attributes: Mapping[str, Any]) -> str:
    """Return the versions, platform, sources and config of a store."""
    facts = {**attributes["versions"], **attributes["platform"]}
    if known := fingerprint_of(attributes):
        facts[FINGERPRINT] = str(known)
    config = {"sha256": attributes["config_sha256"], **attributes["config"]}
    text = yaml.safe_dump(config, sort_keys=False, default_flow_style=None, width=88)
    parts = [table([("made with", ""), *facts.items()])]
    if SOURCES in attributes:
        parts.append("\n".join(["merged from", *sources_lines(stored_sources(attributes))]))
    if note := import_note(attributes):
        parts.append(note)
    return "\n\n".join([*parts, f"config\n{text}"]).rstrip()


def sources_lines(sources: Iterable[SeedSource]) -> list[str]:
    """Return the lines of a table of the seeds that a store's rows come from."""
    rows = [
        (source.seed, source.rows, ", ".join(dict.fromkeys(
            f"grasp_factory {maker.versions.get('grasp_factory', '?')}"
            f" on {maker.platform.get('cpu', '?')}" for maker in source.made_with
        )))
        for source in sources
    ]  # fmt: skip
    return table([("seed", "rows", "made with"), *rows], right=(0, 1)).splitlines()


def _tally_table(title: str, tallies: Mapping[str, Tally]) -> str:
    rows = [(key, t.episodes, percent(t.success_rate)) for key, t in tallies.items()]
    return table([(title, "episodes", "success"), *rows], right=(1, 2))


def _outcome_table(store: StoreSummary) -> str:
    rows: list[tuple[object, ...]] = [
        (word, number, percent(number / store.committed), bar(number / store.committed, BAR))
        for word, number in store.outcomes.items()
    ]
    if store.quarantined:
        rows.append(("quarantined", store.quarantined, "", ""))
    return table([("outcome", "episodes", "share", ""), *rows], right=(1, 2))


def _family_table(store: StoreSummary) -> str:
    """Return a table of object families, largest first, with a column for each policy."""
    if not store.families:
        return ""
    policies = list(store.policies) if len(store.policies) > 1 else []
    ordered = sorted(store.families.items(), key=lambda item: (-item[1].episodes, item[0]))
    digits = len(str(store.committed))
    rows = [
        (family, tally.episodes, percent(tally.success_rate),
         *(_cell(store.families_by_policy[family].get(policy), digits) for policy in policies))
        for family, tally in ordered[:MOST_ROWS]
    ]  # fmt: skip
    text = table(
        [("object family", "episodes", "success", *policies), *rows],
        right=range(1, 3 + len(policies)),
    )
    more = [tally for _, tally in ordered[MOST_ROWS:]]
    if not more:
        return text
    episodes, successes = sum(t.episodes for t in more), sum(t.successes for t in more)
    rest = f"and {len(more)} more: {count(episodes, 'episode')}, {percent(successes / episodes)}"
    return f"{text}\n{rest} success (--json lists all)"


def _tag_table(tags: Mapping[str, int]) -> str:
    if not tags:
        return ""
    text = table([("tag", "rows"), *list(tags.items())[:MOST_ROWS]], right=(1,))
    more = len(tags) - MOST_ROWS
    return text if more <= 0 else f"{text}\nand {more} more (--json lists all)"


def _cell(tally: Tally | None, digits: int) -> str:
    """Return the number of episodes and the success rate of a family with a policy."""
    return f"{tally.episodes:>{digits}} {percent(tally.success_rate):>7}" if tally else "-"
