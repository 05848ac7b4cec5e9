"""Series of an attempt as curves for people: in groups with units and clocks, and with phases."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from grasp_factory.core.enums import UNKNOWN, Phase, names
from grasp_factory.core.geometry import Array
from grasp_factory.core.shown_units import SHOWN_UNITS
from grasp_factory.labels.rule import target_com
from grasp_factory.signals.touch import contact_values

Series = Mapping[str, NDArray[Any]]

PADS = ("left", "right")
AXES = ("x", "y", "z")


@dataclass(frozen=True, slots=True, kw_only=True)
class CurveGroup:
    """Curves that share an axis."""

    key: str
    title: str
    units: str
    clock: str
    """Source of the curves' times: ``streams`` or ``imu``."""
    names: tuple[str, ...]
    """One for each curve."""
    values: NDArray[Any]
    """(n, curves), n records of the streams or samples of the IMU."""


@dataclass(frozen=True, slots=True, kw_only=True)
class PhaseSpan:
    """Consecutive records of one phase."""

    name: str
    start: float
    """Time of its first record, seconds."""
    end: float
    """Time of the next phase's first record; in the last phase, time of its own last record."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Moment:
    """A record worth looking at."""

    name: str
    record: int


def curve_groups(
    streams: Series, imu: Series, object_com: Array, rest_height: float
) -> tuple[CurveGroup, ...]:
    """Return the recorded series of an attempt in groups, always in the same order.

    A group is left out if its arrays are missing, as in stores of older versions, or if nothing of
    it was measured, as in real episodes.

    Args:
        streams: ``Episode.streams``.
        imu: ``Episode.imu``.
        object_com: The target's centre of mass in its own frame, (3,) metres.
        rest_height: Height of the centre of mass before the attempt, metres.
    """
    found: list[CurveGroup] = []

    def add(key: str, title: str, units: str, words: tuple[str, ...], *columns: Any) -> None:
        clock = "imu" if key.startswith("imu_") else "streams"
        values = np.column_stack(columns) if columns[0].ndim == 1 else columns[0]
        if len(values) and np.isnan(values).all():
            return
        found.append(
            CurveGroup(key=key, title=title, units=units, clock=clock, names=words, values=values)
        )

    for key, units in (("positions", "rad"), ("velocities", "rad/s"), ("torques", "N m")):
        if f"joint_{key}" in streams:
            values = streams[f"joint_{key}"]
            joints = tuple(f"joint {i + 1}" for i in range(values.shape[1]))
            add(f"joint_{key}", f"joint {key}", units, joints, values)
    if {"gripper_width", "gripper_width_target"} <= set(streams):
        width, target = streams["gripper_width"], streams["gripper_width_target"]
        add("gripper_width", "gripper width", "m", ("measured", "target"), width, target)
    if "gripper_force" in streams:
        add("gripper_force", "gripper force", "N", ("motor",), streams["gripper_force"])
    if {"tactile_force", "tactile_normal"} <= set(streams) and touch_was_measured(streams):
        add("pad_force", "pad normal force", "N", PADS, pad_forces(streams))
    if "wrist_wrench" in streams:
        wrench = streams["wrist_wrench"]
        add("wrist_force", "wrist force", "N", AXES, wrench[:, :3])
        add("wrist_torque", "wrist torque", "N m", AXES, wrench[:, 3:])
    if "specific_force" in imu:
        add("imu_specific_force", "IMU specific force", "m/s2", AXES, imu["specific_force"])
    if "angular_velocity" in imu:
        add("imu_angular_velocity", "IMU angular velocity", "rad/s", AXES, imu["angular_velocity"])
    if "object_pose" in streams:
        height = target_com(streams, object_com)[:, 2] - rest_height
        add("object_height", "target above its rest", "m", ("centre of mass",), height)
    return tuple(found)


def in_shown_unit(group: CurveGroup) -> CurveGroup:
    """Return a group in the unit in which people see its quantity."""
    shown = SHOWN_UNITS.get(group.key)
    if shown is None:
        return group
    return replace(group, units=shown.unit, values=shown.factor * group.values)


def pad_forces(streams: Series) -> Array:
    """Return the normal force on each pad over time, from all bodies, (n, 2) newtons."""
    return np.asarray(contact_values(streams).sum(axis=2))


def touch_was_measured(streams: Series) -> bool:
    """Return whether there is touch of the pads: real episodes have none.

    Args:
        streams: with ``tactile_wrench``, which is NaN only where nothing was measured.
    """
    wrench = streams["tactile_wrench"]
    return not len(wrench) or not np.isnan(wrench).all()


def phase_spans(streams: Series) -> tuple[PhaseSpan, ...]:
    """Return the spans of consecutive records of one phase, in order.

    Records whose phase is not known, as those of real episodes, are in none.
    """
    phase, times = streams["phase"], streams["timestamp"]
    if not len(phase):
        return ()
    starts = [0, *(np.flatnonzero(np.diff(phase.astype(int))) + 1).tolist()]
    words = names(Phase)
    return tuple(
        PhaseSpan(
            name=words[int(phase[start])] if int(phase[start]) < len(words) else "unknown",
            start=float(times[start]),
            end=float(times[min(stop, len(times) - 1)]),
        )
        for start, stop in zip(starts, [*starts[1:], len(phase)], strict=True)
        if phase[start] != UNKNOWN
    )


def touch_moments(streams: Series) -> tuple[Moment, ...]:
    """Return up to three records at which to look at the pads, in order of time.

    They are the end of the closing, the largest force on both pads together, and the end of the
    hold (or of the attempt). Records without contact and repeated records are left out.
    """
    force = pad_forces(streams).sum(axis=1)
    if not (force > 0.0).any():
        return ()
    phase = streams["phase"]
    wanted = {int(np.argmax(force)): "largest force"}
    for part, name in ((Phase.CLOSE, "end of closing"), (Phase.HOLD, "end of hold")):
        records = np.flatnonzero(phase == part)
        if len(records):
            wanted.setdefault(int(records[-1]), name)
    if Phase.HOLD not in phase:
        wanted.setdefault(len(force) - 1, "end")
    return tuple(
        Moment(name=name, record=record)
        for record, name in sorted(wanted.items())
        if force[record] > 0.0
    )
