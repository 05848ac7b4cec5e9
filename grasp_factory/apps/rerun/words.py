"""An episode as text: its outcome, its object and policy, and its measurements."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from grasp_factory.core.episode import Episode
from grasp_factory.core.schema import FIELDS
from grasp_factory.core.shown_units import SHOWN_UNITS
from grasp_factory.core.text_format import escaped

_SHOWN_FIRST = ("object_id", "object_family", "policy", "split", "seed", "index")


def episode_text(episode: Episode) -> str:
    """Return Markdown: the outcome, and a table of all columns with one value."""
    units = {row.path.removeprefix("episodes/"): row.units for row in FIELDS}
    spec = episode.spec
    values: dict[str, Any] = {"seed": spec.seed, "index": spec.index, **episode.columns}
    names = [*_SHOWN_FIRST, *sorted(set(values) - set(_SHOWN_FIRST))]
    rows = [
        f"| {name} | {_shown(name, values[name], units.get(name, ''))} |"
        for name in names
        if np.ndim(values[name]) == 0
    ]
    head = f"# {spec.index}: {episode.outcome.name.lower().replace('_', ' ')}"
    return "\n".join([head, "", "| what | value |", "|---|---|", *rows]) + "\n"


def _shown(name: str, value: Any, units: str) -> str:
    if name in SHOWN_UNITS and math.isfinite(value):
        return SHOWN_UNITS[name].text(float(value))
    return f"{_word(value)} {units}"


def _word(value: Any) -> str:
    if isinstance(value, str):
        return "".join("\\" + c if c in "\\|`*_<>[]#" else c for c in escaped(value)) or "-"
    number = float(value)
    if math.isnan(number):
        return "-"
    return f"{number:.4g}" if number % 1 else f"{number:.0f}"
