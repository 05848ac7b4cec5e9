"""Orientation filters: level where gravity is, on known motions, with clear errors."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest
from support.inertial_motion import inertial_motion, tilt_errors

from grasp_factory.errors import ConfigError, MissingLibraryError, UnknownNameError, UsageError
from grasp_factory.signals import BMI088, apply_imu_noise
from grasp_factory.signals.orientation import FILTERS, estimate

RATE = 200.0
STILL = np.tile([0.0, 0.0, 9.81], (200, 1)), np.zeros((200, 3))
MOST_TILT = {"complementary": 8.0}
"""Degrees RMS on a motion with noise; of the others 2.5."""


@pytest.fixture(params=FILTERS)
def name(request: pytest.FixtureRequest) -> Iterator[str]:
    yield request.param


def test_a_row_knows_its_name_and_says_what_it_is(name: str) -> None:
    assert FILTERS[name].name == name
    assert 10 < len(FILTERS[name].description) <= 100


def test_a_sensor_at_rest_is_level_and_upright(name: str) -> None:
    found = estimate(name, *STILL, RATE)
    assert found.shape == (200, 4)
    assert np.abs(np.linalg.norm(found, axis=1) - 1.0).max() < 1e-6
    assert np.abs(found[:, 3]).min() > 0.9999


@pytest.mark.parametrize("roll", [0.4, -1.2, 3.0])
def test_a_tilted_sensor_at_rest_keeps_its_tilt(name: str, roll: float) -> None:
    force = np.tile([0.0, 9.81 * np.sin(roll), 9.81 * np.cos(roll)], (200, 1))
    found = estimate(name, force, np.full((200, 3), 1e-9), RATE)
    x, y, z, w = found[-1]
    up = np.array([2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)])
    assert np.abs(up - force[0] / 9.81).max() < 0.01


def test_a_motion_with_the_noise_of_a_bmi088_is_followed(name: str) -> None:
    motion = inertial_motion(seconds=8.0, rate_hz=RATE, seed=3)
    read = apply_imu_noise(BMI088, motion.specific_force, motion.angular_velocity, RATE, seed=1)
    bias = np.mean(np.subtract(read, (motion.specific_force, motion.angular_velocity)), axis=1)
    found = estimate(name, read[0] - bias[0], read[1] - bias[1], RATE)
    tilt = np.sqrt(np.mean(tilt_errors(found, motion.quat_xyzw) ** 2))
    assert tilt < MOST_TILT.get(name, 2.5)


def test_a_mahony_filter_without_integral_works() -> None:
    assert len(estimate("mahony", *STILL, RATE, {"integral": 0.0})) == 200


def test_an_unknown_filter_or_setting_is_named() -> None:
    with pytest.raises(UnknownNameError, match="unknown filter 'mahoni'; did you mean 'mahony'"):
        estimate("mahoni", *STILL, RATE)
    with pytest.raises(ConfigError, match=r"unknown key 'ekf\.noise'"):
        estimate("ekf", *STILL, RATE, {"noise": 1.0})
    with pytest.raises(ConfigError, match=r"madgwick\.gain: got -1\.0"):
        estimate("madgwick", *STILL, RATE, {"gain": -1.0})


@pytest.mark.parametrize(
    ("force", "speed", "rate", "words"),
    [
        (np.ones((3, 2)), np.ones((3, 2)), RATE, "valid: \\(N, 3\\)"),
        (np.ones((0, 3)), np.ones((0, 3)), RATE, "valid: \\(N, 3\\)"),
        (np.full((3, 3), np.nan), np.ones((3, 3)), RATE, "not finite"),
        (np.zeros((3, 3)), np.ones((3, 3)), RATE, "first specific force is 0"),
        (np.ones((3, 3)), np.ones((3, 3)), 0.0, "rate_hz 0.0"),
    ],
)
def test_other_arrays_are_refused(force, speed, rate: float, words: str) -> None:
    with pytest.raises(UsageError, match=words):
        estimate("gyroscope", force, speed, rate)


def test_a_missing_library_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("grasp_factory.core.optional.find_spec", lambda name: None)
    with pytest.raises(MissingLibraryError, match=r"pip install 'grasp-factory\[filters\]'"):
        estimate("fusion", *STILL, RATE)
