"""Time series for a calibration, from a CSV file, a session or a bag."""

from __future__ import annotations

from array import array
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from grasp_factory.capture.calibration.csv_columns import doubles, read_columns
from grasp_factory.capture.calibration.recorded_messages import message_file, messages_of
from grasp_factory.core.executors.base import SendMessage
from grasp_factory.core.executors.import_process import in_import_process
from grasp_factory.core.geometry import Array
from grasp_factory.core.optional import require
from grasp_factory.errors import CaptureError, UsageError

_LEAST_SAMPLES = 2


@dataclass(frozen=True, slots=True, kw_only=True)
class RecordedSeries:
    """Samples of a sensor."""

    times: Array
    """(N,) s."""
    values: Array
    """(N, C)"""
    extra: Array
    """(N,) an additional column; NaN where it is not there."""

    @property
    def rate_hz(self) -> float:
        """Samples per second in the mean: single times may be those of arrival, in batches.

        Raises:
            CaptureError: if the times do not ascend.
        """
        duration = float(self.times[-1] - self.times[0])
        if not (duration > 0.0 and (np.diff(self.times) >= 0.0).all()):
            raise CaptureError("the times of the samples do not ascend; check the column timestamp")
        return (len(self.times) - 1) / duration


@dataclass(frozen=True, slots=True, kw_only=True)
class SeriesForm:
    """How a kind of series is written."""

    columns: tuple[str, ...]
    """In a CSV file, beside ``timestamp`` (s)."""
    extra: str
    """An additional column of a CSV file; empty for none."""
    message: str
    """Type of the ROS message."""
    fields: Callable[[Any], Sequence[float]]
    """Returns the values of a message in the order of the columns."""


def _imu_fields(message: Any) -> Sequence[float]:
    a, w = message.linear_acceleration, message.angular_velocity
    return (a.x, a.y, a.z, w.x, w.y, w.z)


def _wrench_fields(message: Any) -> Sequence[float]:
    f, t = message.wrench.force, message.wrench.torque
    return (f.x, f.y, f.z, t.x, t.y, t.z)


FORMS: Mapping[str, SeriesForm] = {
    "imu": SeriesForm(
        columns=("ax", "ay", "az", "wx", "wy", "wz"),
        extra="temperature",
        message="sensor_msgs/msg/Imu",
        fields=_imu_fields,
    ),
    "wrench": SeriesForm(
        columns=("fx", "fy", "fz", "tx", "ty", "tz"),
        extra="",
        message="geometry_msgs/msg/WrenchStamped",
        fields=_wrench_fields,
    ),
}
"""By kind: specific force (m/s2) and angular velocity (rad/s); force (N) and torque (N m)."""
_TEMPERATURE = "sensor_msgs/msg/Temperature"


@dataclass(frozen=True, slots=True, kw_only=True)
class SeriesJob:
    """The task of the process that reads a series."""

    source: Path
    kind: str
    """A key of ``FORMS``."""
    topic: str
    """Empty for the only one."""


def read_series(source: Path, kind: str, topic: str = "") -> RecordedSeries:
    """Return a series; a process with limits reads it.

    Args:
        source: a CSV file, the folder of a session, or an MCAP file or bag.
        kind: a key of ``FORMS``.
        topic: of a session or bag; empty if there is one of this kind.

    Raises:
        UsageError: if the source cannot be opened, or has several such topics.
        CaptureError: if it is damaged, or holds no such series.
        LimitError: if it needs too much memory or time.
    """
    if message_file(source) is not None:
        require("rosbags", extra="ros")
    job = SeriesJob(source=source, kind=kind, topic=topic)
    found: RecordedSeries = in_import_process(series_in, job, source)
    return found


def series_in(job: SeriesJob, report: SendMessage) -> RecordedSeries:
    """Do the job of ``read_series``."""
    form, file = FORMS[job.kind], message_file(job.source)
    if file is not None:
        series = _of_messages(file, form, job.topic)
    elif job.source.suffix == ".csv":
        series = _of_csv(job.source, form)
    else:
        raise UsageError(
            f"{job.source}: valid: a .csv file, the folder of a session, a .mcap or a .bag"
        )
    if len(series.times) < _LEAST_SAMPLES:
        got = len(series.times)
        raise CaptureError(f"{job.source}: got {got} samples, valid: {_LEAST_SAMPLES} or more")
    if not (np.isfinite(series.times).all() and np.isfinite(series.values).all()):
        raise CaptureError(f"{job.source}: cells are empty or not finite; valid: numbers only")
    return series


def _of_csv(path: Path, form: SeriesForm) -> RecordedSeries:
    optional = (form.extra,) if form.extra else ()
    columns = read_columns(path, ("timestamp", *form.columns), optional)
    times = columns["timestamp"]
    return RecordedSeries(
        times=times,
        values=np.column_stack([columns[name] for name in form.columns]),
        extra=columns.get(form.extra, np.full(len(times), np.nan)),
    )


def _of_messages(file: Path, form: SeriesForm, topic: str) -> RecordedSeries:
    times, values = array("d"), array("d")
    for time, message in messages_of(file, (form.message,), topic):
        times.append(time)
        values.extend(form.fields(message))
    found = doubles(times)
    extra = np.full(len(found), np.nan)
    if form.extra:
        extra = _temperature(file, topic, found, extra)
    return RecordedSeries(
        times=found, values=doubles(values).reshape(-1, len(form.columns)), extra=extra
    )


def _temperature(file: Path, topic: str, at: Array, nothing: Array) -> Array:
    """Return the temperature at the samples: of the topic beside theirs, if there is one."""
    beside = f"{topic.rpartition('/')[0]}/temperature" if topic else ""
    try:
        pairs = [(t, m.temperature) for t, m in messages_of(file, (_TEMPERATURE,), beside)]
    except UsageError:
        return nothing
    if not pairs:
        return nothing
    times, values = np.array(pairs, np.float64).T
    return np.asarray(np.interp(at, times, values))
