"""Noise figures of an inertial sensor at rest, against the noise that was put in."""

from __future__ import annotations

import numpy as np
import pytest

from grasp_factory.capture.calibration.allan import allan_curve
from grasp_factory.errors import CaptureError
from grasp_factory.signals.noise.imu import TriadNoise, _corrupt

RATE = 100.0
TRUTH = TriadNoise(
    noise_density=(2e-4, 3e-4, 4e-4),
    turn_on_bias=0.01,
    bias_walk=5e-5,
    full_scale=100.0,
    resolution=0.0,
)


@pytest.fixture(scope="module")
def record() -> np.ndarray:
    still = np.zeros((int(3600 * RATE), 3))
    return _corrupt(TRUTH, still, RATE, np.random.SeedSequence(4))


def test_density_and_walk_are_those_that_were_put_in(record: np.ndarray) -> None:
    curve, figures = allan_curve(record, RATE)
    assert [axis.density for axis in figures] == pytest.approx(TRUTH.noise_density, rel=0.05)
    assert [axis.random_walk for axis in figures] == pytest.approx([5e-5] * 3, rel=0.35)
    assert curve.deviation.shape == curve.model.shape == (len(curve.tau), 3)
    near = np.abs(np.log(curve.model / curve.deviation))[curve.tau < 100.0]
    assert near.max() < 0.25


def test_a_large_mean_changes_nothing(record: np.ndarray) -> None:
    plain = allan_curve(record[:20_000], RATE)[1]
    shifted = allan_curve(record[:20_000] + 9.81, RATE)[1]
    assert [a.density for a in plain] == pytest.approx([a.density for a in shifted], rel=1e-6)


def test_white_noise_alone_has_hardly_a_walk() -> None:
    white = np.random.default_rng(1).normal(0.0, 1e-3, (60_000, 3))
    for axis in allan_curve(white, RATE)[1]:
        assert axis.density == pytest.approx(1e-4, rel=0.03)
        assert axis.random_walk < 2e-5


def test_a_short_record_is_refused() -> None:
    with pytest.raises(CaptureError, match="got 999 samples, valid: 1000 or more"):
        allan_curve(np.zeros((999, 3)), RATE)


def test_a_sensor_that_is_stuck_is_refused() -> None:
    with pytest.raises(CaptureError, match="an axis does not vary"):
        allan_curve(np.ones((2000, 3)), RATE)
