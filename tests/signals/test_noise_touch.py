"""Noise of touch, wrist and encoders against what its figures say."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from grasp_factory.core.geometry import Array
from grasp_factory.errors import UsageError
from grasp_factory.signals.noise import (
    LIGHTWEIGHT,
    MINI45,
    PIEZORESISTIVE,
    TactileNoise,
    WrenchNoise,
    encoders,
    tactile,
    wrench,
)

SEEDS = st.integers(0, 2**32 - 1)
STILL = TactileNoise(noise=(0.0, 0.0), gain_spread=0.0, creep=0.0, hysteresis=0.0,
                     full_scale=(100.0, 2.0), resolution=(0.0, 0.0))  # fmt: skip
ZERO = (0.0,) * 6
QUIET = WrenchNoise(noise=ZERO, drift=ZERO, idle=0.0, full_scale=(math.inf,) * 6, resolution=ZERO)


def pads(force: Array) -> Array:
    """Return wrenches (T, 2, 6) of both pads with a force along y over time."""
    out = np.zeros((len(force), 2, 6))
    out[..., 1] = np.asarray(force)[:, None]
    return out


class TestTactile:
    @given(SEEDS)
    def test_an_ideal_pad_shows_the_load(self, seed: int) -> None:
        load = np.random.default_rng(seed).normal(0.0, 0.3, (20, 2, 6))
        np.testing.assert_array_equal(tactile.corrupt(STILL, load, 120.0, seed), load)

    def test_the_noise_has_its_size_in_force_and_torque(self) -> None:
        noise = dataclasses.replace(STILL, noise=(0.5, 0.01))
        read = tactile.corrupt(noise, pads(np.zeros(5000)), 120.0, 0)
        expected = np.repeat([0.5, 0.01], 3)
        np.testing.assert_allclose(read.std(axis=(0, 1)), expected, rtol=0.05)

    def test_a_constant_load_creeps_up_by_its_share_per_decade(self) -> None:
        noise = dataclasses.replace(STILL, creep=0.05)
        read = tactile.corrupt(noise, pads(np.full(1000, 20.0)), 10.0, 0)[:, 0, 1]
        assert read[0] == pytest.approx(20.0)
        assert read[90] == pytest.approx(21.0)  # after 9 s, where log10(1 + 9) is 1
        assert read[990] == pytest.approx(22.0, rel=1e-3)

    def test_after_the_load_is_gone_the_creep_fades(self) -> None:
        noise = dataclasses.replace(STILL, creep=0.05)
        force = np.r_[np.full(50, 20.0), np.zeros(500)]
        read = tactile.corrupt(noise, pads(force), 10.0, 0)[:, 0, 1]
        after = read[50:]
        assert 0.0 < after[-1] < 0.1 * after[0]
        assert (np.diff(after) < 0.0).all()

    def test_loading_reads_less_and_unloading_more_by_half_the_loop(self) -> None:
        force = np.r_[np.linspace(0.0, 40.0, 81), np.linspace(40.0, 0.0, 81)]
        noise = dataclasses.replace(STILL, hysteresis=0.02)
        read = tactile.corrupt(noise, pads(force), 120.0, 0)[:, 1, 1]
        np.testing.assert_allclose(read[:81], 0.98 * force[:81])
        np.testing.assert_allclose(read[90:], 1.02 * force[90:])
        assert read[-1] == 0.0

    @given(SEEDS, st.floats(0.0, 0.2))
    def test_hysteresis_is_within_its_share_and_knows_no_rate(
        self, seed: int, share: float
    ) -> None:
        load = np.random.default_rng(seed).normal(0.0, 10.0, (30, 2, 6))
        felt = tactile.lag(load, share)
        assert (np.abs(felt - load) <= share * np.abs(load) + 1e-12).all()
        np.testing.assert_array_equal(tactile.lag(load.repeat(3, axis=0), share)[2::3], felt)

    def test_each_pad_has_one_gain(self) -> None:
        noise = dataclasses.replace(STILL, gain_spread=0.1)
        load = pads(np.linspace(1.0, 10.0, 5))[..., 1:2]
        ratios = np.array([
            (tactile.corrupt(noise, pads(np.linspace(1.0, 10.0, 5)), 120.0, s)[..., 1:2] / load)
            for s in range(300)
        ])  # fmt: skip
        np.testing.assert_allclose(ratios.std(axis=1), 0.0, atol=1e-12)
        np.testing.assert_allclose(ratios[:, 0, :, 0].std(axis=0), 0.1, rtol=0.15)
        assert (ratios[:, 0, 0] != ratios[:, 0, 1]).all()

    def test_it_reads_in_counts_and_saturates(self) -> None:
        read = tactile.corrupt(PIEZORESISTIVE, pads(np.linspace(0.0, 300.0, 50)), 120.0, 0)
        assert read[-1, 0, 1] == 111.0
        counts = read[:20, :, :3] / (111.0 / 2**11)
        np.testing.assert_allclose(counts, np.round(counts), atol=1e-9)

    @given(SEEDS)
    def test_the_points_forces_add_up_to_what_the_pad_reads(self, seed: int) -> None:
        rng = np.random.default_rng(seed)
        force = rng.normal(size=(6, 2, 4, 3))
        force[0], force[1, :, 2:] = np.nan, np.nan
        clean = np.zeros((6, 2, 6))
        clean[..., :3] = np.nan_to_num(force).sum(axis=2)
        shown = clean + rng.normal(size=clean.shape)
        streams = {"tactile_force": force, "tactile_wrench": clean}
        carried = tactile.carry_over(streams, shown)
        np.testing.assert_array_equal(np.isnan(carried), np.isnan(force))
        total = np.nan_to_num(carried).sum(axis=2)
        np.testing.assert_allclose(total[1:], shown[1:, :, :3], atol=1e-9)


class TestWrist:
    @given(SEEDS)
    def test_an_ideal_sensor_shows_the_load(self, seed: int) -> None:
        load = np.random.default_rng(seed).normal(0.0, 20.0, (20, 6))
        np.testing.assert_array_equal(wrench.corrupt(QUIET, load, 120.0, seed), load)

    def test_the_mini45_is_as_noisy_as_its_resolution(self) -> None:
        noise = dataclasses.replace(MINI45, drift=ZERO)
        read = wrench.corrupt(noise, np.zeros((20_000, 6)), 120.0, 0)
        expected = [1 / 16, 1 / 16, 1 / 16, 1 / 752, 1 / 752, 1 / 1504]
        np.testing.assert_allclose(read.std(axis=0), expected, rtol=0.03)

    @pytest.mark.parametrize("rate_hz", [30.0, 120.0])
    def test_the_zero_walks_with_the_root_of_time(self, rate_hz: float) -> None:
        noise = dataclasses.replace(QUIET, drift=(0.2,) * 6)
        ends = np.array([
            wrench.corrupt(noise, np.zeros((int(9 * rate_hz), 6)), rate_hz, s)[-1]
            for s in range(300)
        ])  # fmt: skip
        assert ends.std() == pytest.approx(0.2 * 3.0, rel=0.1)

    def test_it_starts_where_the_zero_has_drifted_since_the_tare(self) -> None:
        noise = dataclasses.replace(QUIET, drift=(0.1,) * 6, idle=400.0)
        starts = np.array([wrench.corrupt(noise, np.zeros((1, 6)), 1e6, s)[0] for s in range(300)])
        assert starts.std() == pytest.approx(2.0, rel=0.1)

    def test_it_reads_in_counts_and_saturates(self) -> None:
        load = np.outer(np.linspace(-400.0, 400.0, 30), np.ones(6))
        read = wrench.corrupt(MINI45, load, 120.0, 0)
        assert read[-1].tolist() == [145.0, 145.0, 290.0, 5.0, 5.0, 5.0]
        assert read[0].tolist() == [-145.0, -145.0, -290.0, -5.0, -5.0, -5.0]
        counts = read / np.array(MINI45.resolution)
        np.testing.assert_allclose(counts, np.round(counts), atol=1e-6)

    @given(SEEDS)
    def test_a_longer_series_starts_with_the_same_noise(self, seed: int) -> None:
        short, long = (wrench.corrupt(MINI45, np.zeros((n, 6)), 120.0, seed) for n in (7, 19))
        np.testing.assert_array_equal(short, long[:7])


class TestEncoders:
    def read(self, n: int, speed: float, seed: int = 0) -> encoders.EncoderReading:
        angle = np.tile(np.linspace(0.3, 1.1, n)[:, None], (1, 7))
        self.angle = angle
        return encoders.corrupt(
            LIGHTWEIGHT, angle, np.full((n, 7), speed), np.linspace(0.0, 0.1, n), seed
        )

    def test_positions_err_by_noise_and_counts(self) -> None:
        shown = self.read(3000, 0.0)
        error = shown.joint_positions - self.angle
        assert error.std() == pytest.approx(LIGHTWEIGHT.joint_sigma, rel=0.05)
        counts = shown.joint_positions / math.radians(0.01)
        np.testing.assert_allclose(counts, np.round(counts), atol=1e-6)

    def test_velocities_err_by_two_readings_over_the_window(self) -> None:
        shown = self.read(3000, 0.7)
        error = shown.joint_velocities - 0.7
        expected = math.sqrt(2.0) * LIGHTWEIGHT.joint_sigma / LIGHTWEIGHT.velocity_window
        assert error.std() == pytest.approx(expected, rel=0.05)
        assert abs(error.mean()) < 0.05 * expected

    def test_a_velocity_errs_with_the_position_that_it_is_made_from(self) -> None:
        shown = self.read(3000, 0.7)
        errors = (
            (shown.joint_velocities - 0.7).ravel(),
            (shown.joint_positions - self.angle).ravel(),
        )
        assert np.corrcoef(*errors)[0, 1] == pytest.approx(math.sqrt(0.5), abs=0.03)

    def test_the_width_is_in_counts(self) -> None:
        width = self.read(100, 0.0).gripper_width
        np.testing.assert_allclose(width / 1e-5, np.round(width / 1e-5), atol=1e-6)
        assert np.abs(width - np.linspace(0.0, 0.1, 100)).max() < 6e-5

    def test_a_window_of_no_time_is_refused(self) -> None:
        with pytest.raises(UsageError, match=r"velocity_window 0.0: valid: above 0"):
            dataclasses.replace(LIGHTWEIGHT, velocity_window=0.0)


@pytest.mark.parametrize("model", [PIEZORESISTIVE, MINI45, LIGHTWEIGHT], ids=repr)
def test_a_negative_figure_is_refused(model: object) -> None:
    field = dataclasses.fields(model)[0].name  # type: ignore[arg-type]
    with pytest.raises(UsageError, match=f"{field} .*: valid: 0 or more"):
        dataclasses.replace(model, **{field: -1.0})  # type: ignore[type-var]
