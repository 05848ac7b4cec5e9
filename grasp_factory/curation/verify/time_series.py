"""Checks of every time series: even timestamps, phases in order, complete contacts."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from grasp_factory.core.enums import Phase
from grasp_factory.core.episode import EpisodeSpec
from grasp_factory.core.sensors import series_groups
from grasp_factory.curation.verify.problems import Fault
from grasp_factory.dataset.row_codec import Row

EVEN = 1e-9
"""Tolerance of a timestamp in seconds: the exact value is a quotient of integers."""
UNIT = 1e-5
"""Tolerance of a normal's length in single precision."""


def series_faults(contents: Row, spec: EpisodeSpec) -> Iterator[Fault]:
    """Yield the path of each time series with an impossible value, and what is wrong with it."""
    rates = {group.name: rate for group in series_groups() if (rate := group.rate(spec))}
    for group, rate in rates.items():
        path = f"{group}/timestamp"
        if path in contents and not _is_even(contents[path], rate):
            yield path, f"does not go on by 1/{rate} s from that on"
    yield from _length_faults(contents, rates)
    phase, level = contents["streams/phase"], contents["streams/shake_level"]
    if (np.diff(phase.astype(int)) < 0).any():
        yield "streams/phase", "goes back to an earlier phase"
    if not np.isin(level, (0.0, *spec.shake.levels)).all():
        yield "streams/shake_level", f"a level other than 0 and {list(spec.shake.levels)}"
    if ((level > 0.0) != (phase == Phase.SHAKE)).any():
        yield "streams/shake_level", "a level outside of the shake, or none in it"
    yield from _contact_faults(contents)


def _is_even(times: NDArray[np.float64], rate: int) -> bool:
    return bool(np.allclose(times, np.arange(1, len(times) + 1) / rate, rtol=0.0, atol=EVEN))


def _length_faults(contents: Row, rates: dict[str, int]) -> Iterator[Fault]:
    """Check that all groups of series end at one time, within a period of the slowest group."""
    ends = {g: len(contents[f"{g}/timestamp"]) for g in rates if f"{g}/timestamp" in contents}
    slowest = max(1.0 / rates[group] for group in ends)
    seconds = {group: count / rates[group] for group, count in ends.items()}
    for group, end in seconds.items():
        if abs(end - seconds["streams"]) > slowest + EVEN:
            yield f"{group}/timestamp", f"ends after {end:g} s, the streams {seconds['streams']:g}"


def _contact_faults(contents: Row) -> Iterator[Fault]:
    """Check that a contact has values if it has a body, and only then."""
    there = contents["streams/tactile_body"] != 0
    for name in ("position", "force", "normal", "depth"):
        values = contents[f"streams/tactile_{name}"]
        is_number, axes = np.isfinite(values), tuple(range(there.ndim, values.ndim))
        if (is_number.all(axes) != there).any() or (is_number.any(axes) != there).any():
            yield f"streams/tactile_{name}", "a contact without body, or a body without contact"
            return
    normals = contents["streams/tactile_normal"][there].astype(np.float64)
    off = np.abs(np.linalg.norm(normals, axis=-1) - 1.0)
    if (off > UNIT).any():
        yield "streams/tactile_normal", f"a normal that is not unit, by {off.max():.2g}"
