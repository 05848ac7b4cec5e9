"""Texts about a run: plan, summary and forecast."""

from __future__ import annotations

from typing import TYPE_CHECKING

from grasp_factory.cli.store_report import store_text
from grasp_factory.core.text_format import (
    count,
    duration_text,
    joined_lines,
    percent,
    size_text,
    table,
)
from grasp_factory.factory.run_request import WHOLE

if TYPE_CHECKING:
    from grasp_factory.factory.dry_run import Forecast
    from grasp_factory.factory.run_records import RunPlan, Summary

MOST_NAMED = 10
"""Quarantined episodes that a summary names."""


def plan_text(plan: RunPlan) -> str:
    """Return one line on what a run will do."""
    there = plan.already_there
    if not plan.blocks and plan.shard == WHOLE:
        if there < plan.episodes:
            return f"{plan.path} already has the {there} episodes of this run."
        return f"{plan.path} is complete: {count(there, 'episode')}."
    if not plan.blocks:
        return f"Part {plan.shard} of {plan.path} is complete."
    part = "" if plan.shard == WHOLE else f", part {plan.shard}"
    config = plan.config
    rest = f" (which has {there})" if there and plan.shard == WHOLE else ""
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
    there = f"{summary.already_there} were already there" if summary.already_there else ""
    head = ", ".join(filter(None, [f"{count(summary.made, 'episode')} made{speed}", there]))
    text = [head, store_text(summary.store, ("policy", "outcome"))]
    if summary.quarantined:
        named = [f"episode {i} is quarantined: {why}" for i, why in summary.quarantined.items()]
        rest = len(named) - MOST_NAMED
        text.append(
            joined_lines([*named[:MOST_NAMED], *([f"and {rest} more"] if rest > 0 else [])])
        )
    return "\n\n".join(text)


def forecast_text(found: Forecast) -> str:
    """Return the forecast of a run as a table."""
    head = f"{count(found.to_make, 'episode')} to make, {found.already_there} already there"
    expected = found.expected
    if expected is None:
        return f"{head}: {found.path} is complete."
    low, high = expected.success_interval or (None, None)
    rows = [
        ("time", duration_text(expected.seconds), f"with {count(found.workers, 'worker')}"),
        ("speed", f"{found.to_make / expected.seconds:.2f} episodes/s", ""),
        ("disk", size_text(expected.bytes), f"of {size_text(found.free_bytes)} free"),
        ("memory", size_text(expected.peak_bytes), "peak, all workers together"),
        (
            "success",
            percent(expected.success_rate),
            f"95 %: {percent(low)} to {percent(high)}",
        ),
    ]
    if expected.quarantined:
        rows.append(("quarantined", str(expected.quarantined), "of the pilot episodes"))
    pilots = f"estimated from {count(expected.pilots, 'pilot episode')} that are not kept"
    lines = [f"{head}; {pilots}:", table(rows)]
    if not found.fits:
        lines.append(f"warning: the disk of {found.path} has too little space")
    return "\n".join(lines)
