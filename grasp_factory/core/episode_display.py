"""How an episode shows itself: a few lines of text, and pictures and curves in a notebook."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from grasp_factory.core.html_parts import curves, figure, html_table, html_text, picture
from grasp_factory.core.linear import norm
from grasp_factory.core.palette import OUTCOMES
from grasp_factory.core.shown_units import SHOWN_UNITS
from grasp_factory.core.text_format import named_lines

if TYPE_CHECKING:
    from grasp_factory.core.episode import Episode

WIDEST = 100
"""Characters of a line of text."""
MOST_LINES = 2
"""Lines of a fact."""
MOST_CAMERAS = 4
"""Cameras that are shown."""
_MEASURED = ("lift_height", "slip_distance", "min_grip_force", "hold_duration", "quality")
"""Columns that say most about an attempt."""


class DisplayedEpisode:
    """The base of ``Episode``: its ``repr``, and its form in a notebook."""

    __slots__ = ()

    def __repr__(self: Episode) -> str:  # type: ignore[misc]
        head = f"Episode {self.spec.index} of seed {self.spec.seed}: {self.outcome}"
        return "\n".join([head, *named_lines(_facts(self), WIDEST, MOST_LINES)])

    def _repr_html_(self: Episode) -> str:  # type: ignore[misc]
        """Return the images before and after, the outcome, the facts and some curves."""
        color = OUTCOMES[str(self.outcome)].light
        badge = f"background:{color};color:white;padding:2px 8px;border-radius:4px"
        head = f"<b>Episode {self.spec.index}</b> of seed {self.spec.seed}"
        return (
            f'<div><p>{head} <span style="{badge}">{html_text(self.outcome)}</span></p>'
            f"<div>{''.join(_pictures(self))}</div>"
            f"<div>{''.join(_figures(self.streams))}</div>"
            f"{html_table((), _facts(self))}</div>"
        )


def _facts(episode: Episode) -> Iterator[tuple[str, str]]:
    """Yield names and texts; each text is one line."""
    spec, columns, target = episode.spec, episode.columns, episode.spec.objects[0]
    others = f", {len(spec.objects) - 1} objects beside it" if spec.objects[1:] else ""
    mass = "" if target.mass is None else f", {target.mass:.3g} kg"
    yield "target", f"{target.object_id} ({target.family}){mass}, split {target.split}{others}"
    yield "grasp", f"{spec.policy} on {spec.robot}" + (", recorded" if episode.is_real else "")
    known = {name: columns[name] for name in _MEASURED if name in columns}
    yield "measured", ", ".join(f"{name} {_number(name, value)}" for name, value in known.items())
    width, height = spec.resolution
    cameras = f"{', '.join(episode.cameras)}: rgb, depth, segmentation, before and after"
    yield "cameras", f"{cameras}, {width} x {height}"
    for name, series in episode.series.items():
        length = len(series["timestamp"])
        seconds = f", {series['timestamp'][-1]:.2f} s" if length else ""
        yield name, f"{length} records{seconds}: {', '.join(series)}"
    yield "columns", f"{len(columns)}: {', '.join(sorted(columns))}"


def _pictures(episode: Episode) -> Iterator[str]:
    for name, frames in list(episode.cameras.items())[:MOST_CAMERAS]:
        for rgb, when in zip(frames.rgb, ("before", "after"), strict=True):
            yield figure(picture(rgb, f"{name} {when}"), f"{name}, {when}")


def _figures(streams: Mapping[str, NDArray[Any]]) -> Iterator[str]:
    """Yield small figures of the series that an attempt is judged by."""
    if not len(streams["timestamp"]):
        return
    for title, units, values in _series(streams):
        known = values[np.isfinite(values)]
        if known.size:
            span = f"{known.min():.3g} to {known.max():.3g} {units}"
            yield figure(curves(streams["timestamp"], values, title), f"{title}: {span}")


def _series(streams: Mapping[str, NDArray[Any]]) -> Iterator[tuple[str, str, NDArray[Any]]]:
    """Yield title, units and values (n, curves) of series that the streams have."""
    if "tactile_wrench" in streams:
        force = norm(streams["tactile_wrench"][..., :3])
        yield "force on the left and right pad", "N", force
    if "gripper_width" in streams:
        yield "gripper width", "mm", 1e3 * streams["gripper_width"][:, None]
    if "object_pose" in streams:
        yield "height of the target", "mm", 1e3 * streams["object_pose"][:, 0, 2:3]
    if "tcp_pose" in streams:
        yield "height of the TCP", "mm", 1e3 * streams["tcp_pose"][:, 2:3]


def _number(name: str, value: Any) -> str:
    if isinstance(value, float) and name in SHOWN_UNITS:
        return SHOWN_UNITS[name].text(value)
    return f"{value:.4g}" if isinstance(value, float) else str(value)
