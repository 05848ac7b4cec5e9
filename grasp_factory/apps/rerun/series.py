"""Logging measurements over time: groups of scalars, and the phases of the attempt."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import rerun as rr

from grasp_factory.apps.rerun.clock import seconds
from grasp_factory.core.episode import Episode
from grasp_factory.core.palette import CURVES, rgb
from grasp_factory.signals.plot_series import CurveGroup, PhaseSpan, in_shown_unit

SERIES = "series"
PHASE = "phase"
LOG = "log"
COLORS = tuple(rgb(curve.dark) for curve in CURVES)
"""Colours of a group's curves, in turn; the viewer is dark."""


def log_series(
    recording: rr.RecordingStream, episode: Episode, groups: Sequence[CurveGroup]
) -> None:
    """Log every group as one entity with a named line for each of its curves."""
    for group in map(in_shown_unit, groups):
        entity = f"{SERIES}/{group.key}"
        colors = [COLORS[i % len(COLORS)] for i in range(len(group.names))]
        recording.log(
            entity,
            rr.SeriesLines(names=[f"{name}, {group.units}" for name in group.names], colors=colors),
            static=True,
        )
        clock = episode.imu if group.clock == "imu" else episode.streams
        values = np.asarray(group.values, np.float64)
        if len(values):
            columns = rr.Scalars.columns(scalars=values.ravel())
            lengths = [values.shape[1]] * len(values)
            recording.send_columns(
                entity, [seconds(clock["timestamp"])], columns.partition(lengths)
            )


def log_phases(recording: rr.RecordingStream, episode: Episode, spans: Sequence[PhaseSpan]) -> None:
    """Log the phases as states and as lines of text, and the outcome at the end."""
    outcome = episode.outcome.name.lower()
    starts, words = [span.start for span in spans], [span.name for span in spans]
    if spans:
        states = rr.StateChange.columns(state=words)
        recording.send_columns(PHASE, [seconds(starts)], states)
    texts, levels = [*words, f"outcome: {outcome}"], ["INFO"] * (len(words) + 1)
    levels[-1] = "INFO" if episode.success else "WARN"
    times = [*starts, spans[-1].end if spans else 0.0]
    columns = rr.TextLog.columns(text=texts, level=levels)
    recording.send_columns(LOG, [seconds(times)], columns)
