"""Orientation from an inertial sensor: several filters with one interface.

``estimate`` returns ``R_world_imu`` as quaternions xyzw; the world's z axis points up. An inertial
sensor does not see north: yaw starts at 0 and drifts with the gyroscope. To add a filter, write a
file in this folder with its settings and its function, and a row here.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from numpy.typing import ArrayLike

from grasp_factory.core.geometry import Array
from grasp_factory.core.optional import require
from grasp_factory.errors import lookup
from grasp_factory.signals.orientation.base import OrientationFilter, inertial_series
from grasp_factory.signals.orientation.complementary import COMPLEMENTARY
from grasp_factory.signals.orientation.ekf import EKF
from grasp_factory.signals.orientation.fusion import FUSION
from grasp_factory.signals.orientation.gyroscope import GYROSCOPE
from grasp_factory.signals.orientation.madgwick import MADGWICK
from grasp_factory.signals.orientation.mahony import MAHONY

FILTERS: Mapping[str, OrientationFilter] = {
    row.name: row for row in (GYROSCOPE, COMPLEMENTARY, MAHONY, MADGWICK, EKF, FUSION)
}
"""Filters by name."""


def estimate(
    name: str,
    specific_force: ArrayLike,
    angular_velocity: ArrayLike,
    rate_hz: float,
    settings: Mapping[str, Any] | None = None,
) -> Array:
    """Return the orientation at each sample, (N, 4) quaternions xyzw of ``R_world_imu``.

    Args:
        name: a name of ``FILTERS``.
        specific_force: (N, 3) m/s2; at rest 9.81 upwards.
        angular_velocity: (N, 3) rad/s, without its bias (``static_bias``).
        rate_hz: Samples per second.
        settings: of the filter; None for its defaults.

    Raises:
        UnknownNameError: for another name.
        ConfigError: for a setting that is unknown or out of range.
        MissingLibraryError: if the filter's library is not installed.
        UsageError: for arrays of another shape, values that are not finite, or a first sample
            without gravity.
    """
    row = lookup(FILTERS, "filter", name)
    record = row.settings_from(settings or {})
    series = inertial_series(specific_force, angular_velocity, rate_hz)
    if row.modules:
        require(*row.modules, extra="filters")
    return row.function(series, record)
