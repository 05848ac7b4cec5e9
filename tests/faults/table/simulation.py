"""Faults in the room ``simulation``: sensors, driver, scene."""

from __future__ import annotations

from faults.fault import Fault

FAULTS = (
    Fault(
        "contact-force-on-the-wrong-body",
        "simulation/sensors/tactile.py",
        "-1.0, c[6], (c[1], c[3])",
        "1.0, c[6], (c[1], c[3])",
        ("simulation/test_sensors.py",),
    ),
    Fault(
        "weakest-contacts-kept",
        "simulation/sensors/tactile.py",
        "np.lexsort((-strength, is_other, group))",
        "np.lexsort((strength, is_other, group))",
        ("simulation/test_sensors.py",),
    ),
    Fault(
        "inertial-frame-not-inverted",
        "simulation/sensors/tracker.py",
        "np.array([-x, -y, -z, w])",
        "np.array([x, y, z, w])",
        ("simulation/test_sensors.py",),
    ),
    Fault(
        "imu-at-the-centre-of-mass",
        "simulation/sensors/imu.py",
        "linear + np.cross(angular, -turned(R, np.array(com)))",
        "linear",
        ("simulation/test_imu.py",),
    ),
    Fault(
        "grip-force-not-clamped",
        "simulation/robot.py",
        "force = min(max(force, low), high)",
        "force = max(force, low)",
        ("conformance/test_robots.py",),
    ),
    Fault(
        "background-of-other-surroundings",
        "simulation/static_scene.py",
        "key = (spec.surroundings, config, spec.resolution, spec.robot)",
        "key = (config, spec.resolution, spec.robot)",
        ("simulation/test_static_scene.py",),
    ),
)
