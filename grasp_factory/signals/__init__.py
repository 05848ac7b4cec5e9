"""Compute sensor signals from recorded arrays: taxel images, loads, noise, one timeline.

Pure functions on the arrays of an ``Episode``: no simulator and no store.
"""

from __future__ import annotations

from grasp_factory.signals.noise.imu import BMI088, ImuNoise, ImuReading, TriadNoise, bmi088
from grasp_factory.signals.noise.imu import apply as apply_imu_noise
from grasp_factory.signals.sample_sets import TimeSets, approximate_time
from grasp_factory.signals.timeline import Aligned, interpolate_poses, linear, nearest, slerp
from grasp_factory.signals.touch import (
    center_of_pressure,
    contact_values,
    net_wrench,
    taxel_centers,
    taxel_image,
)
from grasp_factory.signals.wrench import (
    calibrate,
    compensate_gravity,
    rotations,
    tare,
    tool_load,
)

__all__ = [
    "BMI088",
    "Aligned",
    "ImuNoise",
    "ImuReading",
    "TimeSets",
    "TriadNoise",
    "apply_imu_noise",
    "approximate_time",
    "bmi088",
    "calibrate",
    "center_of_pressure",
    "compensate_gravity",
    "contact_values",
    "interpolate_poses",
    "linear",
    "nearest",
    "net_wrench",
    "rotations",
    "slerp",
    "tare",
    "taxel_centers",
    "taxel_image",
    "tool_load",
]
