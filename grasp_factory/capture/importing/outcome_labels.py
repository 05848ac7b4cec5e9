"""The label of a real episode: from the operator, the gripper's width, and the wrist's force."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from grasp_factory.capture.importing.cuts import LABEL, Cut
from grasp_factory.capture.importing.gripper_motion import GripperClosing
from grasp_factory.capture.importing.import_settings import ImportSettings
from grasp_factory.capture.importing.session_contents import RecordedEvent
from grasp_factory.capture.session.events import EPISODE_END
from grasp_factory.core.enums import Outcome, names
from grasp_factory.core.geometry import Array
from grasp_factory.errors import CaptureError, shown
from grasp_factory.signals.timeline import Ticks


@dataclass(frozen=True, slots=True, kw_only=True)
class RealLabels:
    """What each witness says; None if it says nothing."""

    operator: Outcome | None
    gripper: Outcome | None
    force: Outcome | None

    @property
    def outcome(self) -> Outcome | None:
        """The outcome: what the operator says.

        If the operator says nothing, it is a success if all who say something call it one; else
        the failure that the gripper names, or that the force names. None if nobody says anything.
        """
        if self.operator is not None:
            return self.operator
        told = [label for label in (self.gripper, self.force) if label is not None]
        failures = [label for label in told if label is not Outcome.SUCCESS]
        return next(iter(failures), Outcome.SUCCESS) if told else None


def operator_label(
    events: Sequence[RecordedEvent], cut: Cut, until_ns: int, others: Sequence[Outcome | None]
) -> Outcome | None:
    """Return what the operator says of an episode.

    The list of cuts counts first, then the last event ``label`` with an outcome, then ``success``
    of the event ``episode_end``. An operator who says only that it is no success means the failure
    that another witness names, else ``unstable``.

    Args:
        events: of the session.
        cut: the episode.
        until_ns: the start of the next one, until which a label may follow.
        others: what the other witnesses say.

    Raises:
        CaptureError: for an outcome that is not known.
    """
    if cut.outcome:
        return Outcome[cut.outcome.upper()]
    mine = [event for event in events if cut.start_ns <= event.time_ns < until_ns]
    labels = [e.fields["outcome"] for e in mine if e.name == LABEL and "outcome" in e.fields]
    if labels:
        if labels[-1] not in names(Outcome):
            valid = ", ".join(names(Outcome))
            raise CaptureError(f"event label: got {shown(labels[-1])}, valid: {valid}")
        return Outcome[str(labels[-1]).upper()]
    told = [e.fields.get("success") for e in mine if e.name == EPISODE_END]
    said = next((word for word in told if isinstance(word, bool)), None)
    if said is None or said:
        return Outcome.SUCCESS if said else None
    failures = [label for label in others if label not in (None, Outcome.SUCCESS)]
    return next(iter(failures), Outcome.UNSTABLE)


def gripper_label(
    closing: GripperClosing | None,
    grip: tuple[Ticks, Array] | None,
    end_ns: int,
    min_width_m: float,
) -> Outcome | None:
    """Return what the width says: whether something is between the pads, closed and at the end."""
    if closing is None or grip is None:
        return None
    times, width = grip
    closed = int(np.searchsorted(times, closing.closed_ns))
    last_ns = end_ns if closing.opens_ns is None else min(end_ns, closing.opens_ns)
    last = int(np.searchsorted(times, last_ns, side="right")) - 1
    if closed >= len(width) or last < closed:
        return None
    if width[closed] <= min_width_m:
        return Outcome.NO_CONTACT
    return Outcome.SUCCESS if width[last] > min_width_m else Outcome.LOST_IN_LIFT


def force_label(
    closing: GripperClosing | None,
    forces: tuple[Ticks, Array] | None,
    end_ns: int,
    settings: ImportSettings,
) -> Outcome | None:
    """Return what the wrist says: whether the hand is heavier at the end than before it closed.

    It is the length of the change of the mean force, so that a bias of the sensor cancels. The hand
    must have the same orientation at both times.

    Args:
        closing: of the gripper.
        forces: times (K,) in ns and forces (K, 3) in N.
        end_ns: end of the episode.
        settings: window and smallest weight.
    """
    if closing is None or forces is None:
        return None
    window = round(settings.window_s * 1e9)
    last_ns = end_ns if closing.opens_ns is None else min(end_ns, closing.opens_ns)
    before = _mean_force(forces, closing.begins_ns - window, closing.begins_ns)
    after = _mean_force(forces, last_ns - window, last_ns)
    if before is None or after is None or last_ns - window <= closing.closed_ns:
        return None
    change = float(np.linalg.norm(after - before))
    return Outcome.SUCCESS if change >= settings.min_weight_n else Outcome.LOST_IN_LIFT


def _mean_force(forces: tuple[Ticks, Array], start_ns: int, end_ns: int) -> Array | None:
    times, values = forces
    inside = values[(times >= start_ns) & (times <= end_ns)]
    inside = inside[np.isfinite(inside).all(axis=1)]
    return np.asarray(inside.mean(axis=0)) if len(inside) else None
