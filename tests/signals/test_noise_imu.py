from __future__ import annotations

import dataclasses
import math

import allantools
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from grasp_factory.core.geometry import Array
from grasp_factory.errors import UsageError
from grasp_factory.signals import BMI088, ImuNoise, TriadNoise, apply_imu_noise, bmi088
from grasp_factory.signals.noise.imu import STANDARD_GRAVITY, walk_of_floor

DEGREE = math.pi / 180
IDEAL = TriadNoise(noise_density=(0.0, 0.0, 0.0), turn_on_bias=0.0, bias_walk=0.0,
                   full_scale=math.inf, resolution=0.0)  # fmt: skip
SEEDS = st.integers(0, 2**32 - 1)


def both(**changes: object) -> ImuNoise:
    triad = dataclasses.replace(IDEAL, **changes)
    return ImuNoise(accelerometer=triad, gyroscope=triad)


def allan(series: Array, rate_hz: float, taus: list[float]) -> Array:
    """Return the overlapping Allan deviation of each axis, (taus, 3), by another's code."""
    deviations = []
    for axis in series.T:
        reached, deviation, _, _ = allantools.oadev(axis, rate=rate_hz, data_type="freq", taus=taus)
        np.testing.assert_allclose(reached, taus)
        deviations.append(deviation)
    return np.array(deviations).T


def still(count: int) -> tuple[Array, Array]:
    """Return an IMU at rest: gravity's reaction upwards, no turn."""
    return np.tile([0.0, 0.0, 9.81], (count, 1)), np.zeros((count, 3))


class TestAllanDeviation:
    TAUS = (0.01, 0.1, 1.0)
    """Seconds; of 1000 s of data, so that the estimate itself is good to about 2 %."""

    @pytest.mark.parametrize("rate_hz", [400.0, 240.0, 1000.0])
    def test_white_noise_follows_its_density_at_every_rate(self, rate_hz: float) -> None:
        density = (0.5, 1.0, 2.0)
        count = int(1000 * rate_hz)
        shown = apply_imu_noise(both(noise_density=density), *still(count), rate_hz, 1)
        taus = [round(tau * rate_hz) / rate_hz for tau in self.TAUS]
        expected = np.array(density) / np.sqrt(np.array(taus)[:, None])
        for series in shown:
            np.testing.assert_allclose(allan(series, rate_hz, taus) / expected, 1.0, rtol=0.1)

    @pytest.mark.parametrize("rate_hz", [400.0, 100.0])
    def test_the_bias_walk_follows_its_strength(self, rate_hz: float) -> None:
        walk, taus = 0.3, [0.1, 0.5, 2.0]
        shown = apply_imu_noise(both(bias_walk=walk), *still(int(2000 * rate_hz)), rate_hz, 2)
        expected = walk * np.sqrt(np.array(taus)[:, None] / 3)
        for series in shown:
            np.testing.assert_allclose(allan(series, rate_hz, taus) / expected, 1.0, rtol=0.1)

    def test_the_bmi088_shows_its_datasheets_densities(self) -> None:
        rate_hz, taus = 400.0, list(self.TAUS)
        force, rate = apply_imu_noise(BMI088, *still(400_000), rate_hz, [7, 0])
        root = np.sqrt(np.array(taus)[:, None])
        expected = np.array([160e-6, 160e-6, 190e-6]) * STANDARD_GRAVITY / root
        np.testing.assert_allclose(allan(force, rate_hz, taus) / expected, 1.0, rtol=0.1)
        expected = np.full(3, 0.014 * DEGREE) / root
        np.testing.assert_allclose(allan(rate, rate_hz, taus) / expected, 1.0, rtol=0.1)

    def test_the_bmi088s_gyroscope_has_the_assumed_floor(self) -> None:
        # At 1 Hz, for twelve days: both parts of the model at once, without quantisation.
        noise = dataclasses.replace(
            BMI088, gyroscope=dataclasses.replace(BMI088.gyroscope, resolution=0.0)
        )
        taus = [1.0, 10.0, 30.0, 120.0, 500.0, 1000.0]
        _, rate = apply_imu_noise(noise, *still(1_000_000), 1.0, 11)
        N, K = noise.gyroscope.noise_density[0], noise.gyroscope.bias_walk
        tau = np.array(taus)[:, None]
        expected = np.sqrt(N**2 / tau + K**2 * tau / 3)
        deviation = allan(rate, 1.0, taus)
        np.testing.assert_allclose(deviation / expected, 1.0, rtol=0.1)
        assert deviation.min() == pytest.approx(6.5 * DEGREE / 3600, rel=0.1)

    @given(st.floats(1e-6, 1e-1), st.floats(1e-7, 1e-2))
    def test_the_walk_of_a_floor_has_that_floor(self, density: float, floor: float) -> None:
        walk = walk_of_floor(density, floor)
        tau = math.sqrt(3) * density / walk
        assert math.sqrt(density**2 / tau + walk**2 * tau / 3) == pytest.approx(floor)
        for other in (0.5 * tau, 2.0 * tau):
            assert math.sqrt(density**2 / other + walk**2 * other / 3) > floor


class TestApply:
    @given(SEEDS, st.integers(0, 50))
    def test_the_same_seed_gives_the_same_reading(self, seed: int, count: int) -> None:
        signal = still(count)
        a, b = (apply_imu_noise(BMI088, *signal, 400.0, seed) for _ in range(2))
        np.testing.assert_array_equal(a, b)
        np.testing.assert_array_equal(signal, still(count))

    def test_every_episode_has_its_own_noise(self) -> None:
        a, b = (apply_imu_noise(BMI088, *still(9), 400.0, [3, i]) for i in range(2))
        assert (a.angular_velocity != b.angular_velocity).any()
        assert (a.specific_force != b.specific_force).any()

    def test_a_longer_series_starts_with_the_same_noise(self) -> None:
        short, long = (apply_imu_noise(BMI088, *still(n), 400.0, 5) for n in (10, 25))
        for a, b in zip(short, long, strict=True):
            np.testing.assert_array_equal(a, b[:10])

    def test_the_gyroscopes_model_leaves_the_accelerometer_alone(self) -> None:
        other = dataclasses.replace(BMI088, gyroscope=IDEAL)
        a, b = (apply_imu_noise(n, *still(9), 400.0, 5) for n in (BMI088, other))
        np.testing.assert_array_equal(a.specific_force, b.specific_force)
        np.testing.assert_array_equal(b.angular_velocity, 0.0)

    def test_each_kind_of_noise_has_its_own_random_numbers(self) -> None:
        nothing = np.zeros((1, 3))
        kinds = ({"turn_on_bias": 1.0}, {"noise_density": (1.0, 1.0, 1.0)}, {"bias_walk": 1.0})
        shown = [apply_imu_noise(both(**kind), nothing, nothing, 1.0, 5) for kind in kinds]
        numbers = np.concatenate([np.ravel(reading) for reading in shown])
        assert len(np.unique(numbers)) == len(numbers) == 18

    @given(SEEDS)
    def test_an_ideal_imu_shows_the_signal(self, seed: int) -> None:
        rng = np.random.default_rng(seed)
        force, rate = rng.normal(size=(2, 6, 3))
        shown = apply_imu_noise(both(), force, rate, 400.0, seed)
        np.testing.assert_array_equal(shown, (force, rate))

    def test_the_turn_on_bias_is_constant_and_differs_by_axis_and_start(self) -> None:
        starts = np.array(
            [apply_imu_noise(both(turn_on_bias=2.0), *still(4), 400.0, s)[1] for s in range(400)]
        )
        np.testing.assert_array_equal(starts, np.repeat(starts[:, :1], 4, axis=1))
        biases = starts[:, 0]
        np.testing.assert_allclose(biases.std(axis=0), 2.0, rtol=0.1)
        assert np.abs(biases.mean(axis=0)).max() < 0.3
        assert np.abs(np.corrcoef(biases.T) - np.eye(3)).max() < 0.15

    def test_the_mean_of_a_still_bmi088_is_within_its_offsets(self) -> None:
        force, rate = apply_imu_noise(BMI088, *still(40_000), 400.0, 0)
        assert np.abs(force.mean(axis=0) - [0, 0, 9.81]).max() < 4 * 0.020 * STANDARD_GRAVITY
        assert np.abs(rate.mean(axis=0)).max() < 4 * 1.0 * DEGREE

    @given(SEEDS)
    def test_the_output_is_in_counts_of_sixteen_bits(self, seed: int) -> None:
        rng = np.random.default_rng(seed)
        loud = rng.normal(0.0, 60.0, (20, 3)), rng.normal(0.0, 40.0, (20, 3))
        for series, triad in zip(
            apply_imu_noise(BMI088, *loud, 400.0, seed),
            (BMI088.accelerometer, BMI088.gyroscope),
            strict=True,
        ):
            counts = series / triad.resolution
            np.testing.assert_allclose(counts, np.round(counts), atol=1e-9)
            assert -(2**15) - 1e-6 <= counts.min()
            assert counts.max() <= 2**15 - 1 + 1e-6

    def test_rounding_is_to_the_nearest_count(self) -> None:
        signal = np.array([[0.1, 0.26, -0.3]])
        shown = apply_imu_noise(both(resolution=0.25), signal, signal, 400.0, 0)
        np.testing.assert_array_equal(shown.specific_force, [[0.0, 0.25, -0.25]])

    def test_beyond_its_range_it_saturates(self) -> None:
        signal = np.array([[9.0, -9.0, 0.5]])
        shown = apply_imu_noise(both(full_scale=2.0, resolution=0.5), signal, signal, 400.0, 0)
        np.testing.assert_array_equal(shown.angular_velocity, [[1.5, -2.0, 0.5]])

    @pytest.mark.parametrize("rate_hz", [0.0, -1.0, math.nan])
    def test_a_rate_that_is_none_is_refused(self, rate_hz: float) -> None:
        with pytest.raises(UsageError, match=r"rate_hz \S+: valid: above 0"):
            apply_imu_noise(BMI088, *still(2), rate_hz, 0)


class TestModel:
    @pytest.mark.parametrize(
        ("field", "value"),
        [("noise_density", (0.1, -0.1, 0.1)), ("bias_walk", math.nan), ("resolution", -1.0)],
    )
    def test_a_negative_figure_is_refused(self, field: str, value: object) -> None:
        with pytest.raises(UsageError, match=f"{field} .*: valid: 0 or more"):
            both(**{field: value})

    @pytest.mark.parametrize("g", [3, 6, 12, 24])
    @pytest.mark.parametrize("deg_s", [125, 250, 500, 1000, 2000])
    def test_the_bmi088_has_its_ranges_at_sixteen_bits(self, g: int, deg_s: int) -> None:
        noise = bmi088(g, deg_s)
        assert noise.accelerometer.full_scale == pytest.approx(g * 9.80665)
        assert noise.gyroscope.full_scale == pytest.approx(math.radians(deg_s))
        # The datasheet's sensitivities: 5460 counts per g at 6 g, 16.384 per deg/s at 2000 deg/s.
        assert noise.accelerometer.resolution == pytest.approx(9.80665 / 5460 * g / 6, rel=1e-3)
        assert noise.gyroscope.resolution == pytest.approx(DEGREE / 16.384 * deg_s / 2000)
        assert noise.gyroscope.noise_density == BMI088.gyroscope.noise_density

    @pytest.mark.parametrize(("g", "deg_s"), [(4, 2000), (6, 300)])
    def test_another_range_is_refused_with_the_valid_ones(self, g: int, deg_s: int) -> None:
        with pytest.raises(UsageError, match=r"BMI088: \w+ \d+: valid: (3, 6, 12, 24|125, 250)"):
            bmi088(g, deg_s)

    def test_the_preset_is_the_sensor_after_a_reset(self) -> None:
        assert bmi088(6, 2000) == BMI088
