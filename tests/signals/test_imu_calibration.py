"""Bias, scale, axes and temperature of an inertial sensor, and the low-pass filter."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support.scale import scaled

from grasp_factory.errors import UsageError
from grasp_factory.signals.conditioning import low_pass
from grasp_factory.signals.imu_calibration import (
    TriadModel,
    calibrate_by_gravity,
    calibrate_six_positions,
    static_bias,
    with_temperature,
)

G = 9.80665
BIAS = np.array([0.2, -0.15, 0.08])
SKEWED = np.array([[1.02, 0.01, -0.004], [0.003, 0.97, 0.006], [-0.002, 0.005, 1.01]])
UPPER = np.triu(SKEWED)


def raw_of(true, matrix) -> np.ndarray:
    return np.asarray(true) @ np.linalg.inv(matrix).T + BIAS


def spread_directions(count: int, seed: int) -> np.ndarray:
    found = np.random.default_rng(seed).standard_normal((count, 3))
    return found / np.linalg.norm(found, axis=1, keepdims=True)


class TestPositions:
    SIX = G * np.concatenate([np.eye(3), -np.eye(3)])

    def test_six_positions_give_scale_axes_and_bias(self) -> None:
        fit = calibrate_six_positions(raw_of(self.SIX, SKEWED)[::-1])
        assert np.allclose(fit.model.matrix, SKEWED, atol=1e-9)
        assert np.allclose(fit.model.bias, BIAS, atol=1e-9)
        assert np.allclose(fit.model.correct(raw_of(self.SIX, SKEWED)), self.SIX)
        assert fit.rms < 1e-9

    def test_a_missing_direction_is_named(self) -> None:
        twice = self.SIX.copy()
        twice[4] = twice[3]
        with pytest.raises(UsageError, match="no position with -y up"):
            calibrate_six_positions(raw_of(twice, SKEWED))

    def test_a_position_in_between_is_refused(self) -> None:
        tilted = self.SIX.copy()
        tilted[2] = G * np.array([0.6, 0.0, 0.8])
        with pytest.raises(UsageError, match="position 2 is not along an axis"):
            calibrate_six_positions(raw_of(tilted, SKEWED))

    @settings(max_examples=scaled(10, 200), deadline=None)
    @given(seed=st.integers(0, 10_000))
    def test_the_length_of_gravity_is_enough_for_a_triangular_matrix(self, seed: int) -> None:
        fit = calibrate_by_gravity(raw_of(G * spread_directions(24, seed), UPPER))
        assert np.allclose(fit.model.matrix, UPPER, atol=1e-5)
        assert np.allclose(fit.model.bias, BIAS, atol=1e-4)

    def test_positions_that_are_alike_are_refused(self) -> None:
        alike = [0.0, 0.0, G] + 0.01 * spread_directions(12, 1)
        with pytest.raises(UsageError, match="too alike"):
            calibrate_by_gravity(alike)

    @pytest.mark.parametrize("few", [np.zeros((5, 3)), np.zeros((9, 2)), np.zeros(3)])
    def test_too_few_positions_are_refused(self, few) -> None:
        with pytest.raises(UsageError, match="P of 9 or more"):
            calibrate_by_gravity(few)

    def test_a_position_without_gravity_is_refused(self) -> None:
        with pytest.raises(UsageError, match="a reading is 0"):
            calibrate_by_gravity(np.zeros((9, 3)))


class TestBias:
    def test_it_is_the_mean(self) -> None:
        assert static_bias([[1.0, 2.0, 3.0], [3.0, 2.0, 1.0]]) == (2.0, 2.0, 2.0)
        with pytest.raises(UsageError, match=r"\(0, 3\)"):
            static_bias(np.empty((0, 3)))

    def test_the_slope_over_temperature_is_found_and_taken_off(self) -> None:
        warm = np.linspace(20.0, 45.0, 5000)
        slope = np.array([0.003, -0.001, 0.002])
        noise = np.random.default_rng(0).normal(0.0, 0.01, (5000, 3))
        raw = BIAS + (warm - 30.0)[:, None] * slope + noise
        found = with_temperature(TriadModel(bias=static_bias(raw)), raw, warm)
        assert found is not None
        assert np.allclose(found.temperature_slope, slope, atol=1e-4)
        assert np.abs(found.correct(raw, warm)[-500:].mean(axis=0)).max() < 0.003

    def test_a_temperature_that_hardly_changes_tells_nothing(self) -> None:
        model, raw = TriadModel(), np.zeros((10, 3))
        assert with_temperature(model, raw, np.linspace(25.0, 26.0, 10)) is None
        assert with_temperature(model, raw, np.full(10, np.nan)) is None

    def test_a_sample_without_temperature_is_corrected_at_the_reference(self) -> None:
        model = TriadModel(temperature_slope=(1.0, 0.0, 0.0), reference_temperature=20.0)
        found = model.correct(np.zeros((2, 3)), np.array([np.nan, 21.0]))
        assert found[:, 0].tolist() == [0.0, -1.0]


class TestLowPass:
    TIMES = np.arange(2000) / 400.0

    def test_what_is_slow_stays_and_what_is_fast_goes(self) -> None:
        slow, fast = np.sin(2 * np.pi * 2 * self.TIMES), np.sin(2 * np.pi * 120 * self.TIMES)
        both = np.column_stack([slow + fast, slow])
        found = low_pass(both, 400.0, 20.0)
        assert np.abs(found - slow[:, None])[100:-100].max() < 0.02

    def test_a_live_filter_uses_no_later_sample_and_starts_without_a_step(self) -> None:
        signal = 9.81 + np.random.default_rng(0).normal(0.0, 0.1, 500)
        whole = low_pass(signal, 400.0, 30.0, is_causal=True)
        assert np.allclose(whole[:300], low_pass(signal[:300], 400.0, 30.0, is_causal=True))
        assert abs(whole[0] - signal[0]) < 1e-9

    def test_a_short_series_is_filtered_too(self) -> None:
        for count in (0, 1, 2, 5):
            for is_causal in (False, True):
                found = low_pass(np.ones((count, 3)), 100.0, 10.0, is_causal=is_causal)
                assert np.allclose(found, 1.0)

    @pytest.mark.parametrize(("cutoff", "order"), [(0.0, 2), (200.0, 2), (10.0, 0), (10.0, 9)])
    def test_what_no_filter_can_have_is_refused(self, cutoff: float, order: int) -> None:
        with pytest.raises(UsageError, match="low_pass: "):
            low_pass([1.0], 400.0, cutoff, order=order)
