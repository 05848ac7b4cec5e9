"""The colours of ``palette`` as a style sheet, so that the pages have no list of their own."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache

import numpy as np
from numpy.typing import NDArray

from grasp_factory.core import palette
from grasp_factory.core.palette import Paint

STOPS = 9
"""Colours of a colour map that a gradient is drawn through."""


@cache
def palette_css() -> str:
    """Return the style sheet: variables for both schemes, and the colours of outcomes and phases.

    The variable of the outcome ``no_plan`` is ``--outcome-no-plan``, that of the phase with the
    value 2 is ``--phase-2``.
    """
    paints = _paints()
    light = {name: paint.light for name, paint in paints.items()} | _plain()
    dark = {name: paint.dark for name, paint in paints.items()}
    words = [*palette.OUTCOMES, "quarantined"]
    rules = [
        f"[data-outcome='{word}'] {{ --c: var(--outcome-{_dashed(word)}); }}" for word in words
    ]
    rules += [
        f"[data-phase='{i}'] {{ --phase: var(--phase-{i}); }}" for i in range(len(palette.PHASES))
    ]
    scheme = f"@media (prefers-color-scheme: dark) {{\n{_root(dark)}\n}}"
    return "\n".join([_root(light), scheme, *rules, ""])


def _paints() -> dict[str, Paint]:
    outcomes = {**palette.OUTCOMES, "quarantined": palette.QUARANTINED}
    return {
        **{f"outcome-{_dashed(word)}": paint for word, paint in outcomes.items()},
        **{f"phase-{i}": paint for i, paint in enumerate(palette.PHASES.values())},
        **{f"curve-{i}": paint for i, paint in enumerate(palette.CURVES)},
        "compare-a": palette.CURVES[0],
        "compare-b": palette.CURVES[1],
        "failures": palette.FAILURES,
        "successes": palette.SUCCESS,
    }


def _plain() -> dict[str, str]:
    """Return colours that lie over images, which are the same in both schemes."""
    axes = dict(zip(("axis-x", "axis-y", "axis-z"), palette.AXES, strict=True))
    return {
        "target": palette.TARGET,
        "gripper": palette.GRIPPER,
        "arm": palette.ARM,
        "grasp": palette.GRASP,
        "mark": palette.MARK,
        "outline": palette.OUTLINE,
        **axes,
        "depth-stops": _stops(palette.depth_colors()),
        "force-stops": _stops(palette.force_colors()),
    }


def _stops(colors: NDArray[np.uint8]) -> str:
    places = np.rint(np.linspace(0, len(colors) - 1, STOPS)).astype(int)
    return ", ".join(palette.hex_color(colors[place].tolist()) for place in places)


def _root(variables: Mapping[str, str]) -> str:
    lines = "\n".join(f"  --{name}: {value};" for name, value in variables.items())
    return f":root {{\n{lines}\n}}"


def _dashed(word: str) -> str:
    return word.replace("_", "-")
