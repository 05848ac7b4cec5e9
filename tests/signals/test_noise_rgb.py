"""Color noise against the photon transfer law, on patches whose light is known."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from grasp_factory.errors import UsageError
from grasp_factory.signals.noise import SMALL_PIXELS, RgbNoise
from grasp_factory.signals.noise.rgb import corrupt, linear_to_srgb, srgb_to_linear, streak

CLEAN = RgbNoise(full_well=0.0, read_noise=0.0)


def flat(value: int, size: int = 128) -> np.ndarray:
    return np.full((size, size, 3), value, np.uint8)


def light_of(image: np.ndarray) -> np.ndarray:
    return srgb_to_linear(image / 255.0)


class TestPhotons:
    @pytest.mark.parametrize("value", [80, 100, 120, 160, 200, 225])
    @pytest.mark.parametrize(
        ("full_well", "read_noise"), [(1000.0, 5.0), (300.0, 0.0), (800.0, 12.0)]
    )
    def test_variance_grows_with_light_as_shot_and_read_noise_do(
        self, value: int, full_well: float, read_noise: float
    ) -> None:
        noise = RgbNoise(full_well=full_well, read_noise=read_noise)
        light = light_of(corrupt(noise, flat(value), 0))
        mean = float(srgb_to_linear(value / 255.0))
        variance = mean / full_well + (read_noise / full_well) ** 2
        assert noise.sigma(mean) ** 2 == pytest.approx(variance)
        assert light.var() == pytest.approx(variance, rel=0.1)
        assert light.mean() == pytest.approx(mean, abs=0.02 * math.sqrt(variance) + 2e-4)

    def test_the_presets_mean_is_the_scenes_but_for_its_white_balance(self) -> None:
        for value in (60, 130, 200):
            shown = corrupt(SMALL_PIXELS, flat(value), 3)
            assert shown[..., 1].mean() == pytest.approx(value, abs=0.7)
            assert np.abs(shown.mean(axis=(0, 1)) - value).max() < 12

    def test_white_and_black_stay_in_eight_bits(self) -> None:
        for value in (0, 255):
            shown = corrupt(RgbNoise(full_well=100.0, read_noise=10.0), flat(value), 0)
            assert shown.dtype == np.uint8
            assert abs(int(np.median(shown)) - value) < 60


class TestTransfer:
    @given(st.floats(0.0, 1.0))
    def test_encoding_undoes_decoding(self, value: float) -> None:
        assert linear_to_srgb(srgb_to_linear(value)) == pytest.approx(value, abs=1e-6)

    def test_middle_grey_is_a_fifth_of_the_light(self) -> None:
        assert srgb_to_linear(0.5) == pytest.approx(0.21404, abs=1e-5)  # IEC 61966-2-1

    def test_without_any_imperfection_every_value_comes_back(self) -> None:
        image = np.arange(256, dtype=np.uint8).repeat(3).reshape(16, 16, 3)
        np.testing.assert_array_equal(corrupt(CLEAN, image, 0), image)


class TestWhiteBalance:
    def test_each_image_draws_gains_for_red_and_blue_and_green_stays(self) -> None:
        noise = RgbNoise(full_well=0.0, read_noise=0.0, white_balance=0.1)
        shown = np.array([corrupt(noise, flat(120, 2), seed)[0, 0] for seed in range(400)])
        assert (shown[:, 1] == 120).all()
        logs = np.log(light_of(shown)[:, [0, 2]] / light_of(np.array(120)))
        np.testing.assert_allclose(logs.std(axis=0), 0.1, rtol=0.1)
        assert abs(np.corrcoef(logs.T)[0, 1]) < 0.15


class TestMotionBlur:
    @given(st.floats(0.1, 30.0), st.floats(0.0, math.pi))
    def test_a_streak_has_its_length_and_direction_and_sums_to_one(
        self, length: float, angle: float
    ) -> None:
        kernel = streak(length, angle).astype(np.float64)
        assert kernel.sum() == pytest.approx(1.0, abs=1e-5)
        v, u = np.indices(kernel.shape) - kernel.shape[0] // 2
        along = u * math.cos(angle) + v * math.sin(angle)
        across = -u * math.sin(angle) + v * math.cos(angle)
        # A line of length L has the variance L^2 / 12; sharing among pixels adds up to 1/4 more.
        assert length**2 / 12 - 0.01 < (kernel * along**2).sum() < 1.3 * length**2 / 12 + 0.3
        assert (kernel * across**2).sum() < 0.3
        assert (kernel * along).sum() == pytest.approx(0.0, abs=1e-4)

    def test_a_bright_point_becomes_a_line_with_all_its_light(self) -> None:
        image = flat(0, 41)
        image[20, 20] = 255
        noise = RgbNoise(full_well=0.0, read_noise=0.0, blur_length=8.0, blur_angle=0.0)
        light = light_of(corrupt(noise, image, 0))[..., 0]
        assert light.sum() == pytest.approx(1.0, abs=0.03)
        assert np.flatnonzero(light.sum(axis=1)).tolist() == [20]
        assert 8 <= np.count_nonzero(light[20]) <= 10

    def test_a_flat_image_does_not_blur(self) -> None:
        noise = RgbNoise(full_well=0.0, read_noise=0.0, blur_length=9.0)
        np.testing.assert_array_equal(corrupt(noise, flat(90), 5), flat(90))


class TestJpeg:
    def test_the_lower_the_quality_the_farther_from_the_scene(self) -> None:
        scene = np.random.default_rng(0).integers(60, 200, (16, 16, 3), np.uint8)
        scene = scene.repeat(6, axis=0).repeat(6, axis=1)
        errors = []
        for quality in (95, 70, 20):
            noise = RgbNoise(full_well=0.0, read_noise=0.0, jpeg_quality=quality)
            shown = corrupt(noise, scene, 0).astype(float)
            assert np.abs((shown - scene).mean(axis=(0, 1))).max() < 3.0  # no channel is swapped
            errors.append(np.sqrt(((shown - scene) ** 2).mean()))
        assert errors == sorted(errors)
        assert errors[0] < 20.0

    @pytest.mark.parametrize("quality", [0, 101])
    def test_a_quality_that_is_none_is_refused(self, quality: int) -> None:
        with pytest.raises(UsageError, match=f"jpeg_quality {quality}: valid: 1 to 100"):
            RgbNoise(full_well=1.0, read_noise=0.0, jpeg_quality=quality)


@given(st.integers(0, 2**32 - 1))
def test_the_same_seed_gives_the_same_image_and_another_another(seed: int) -> None:
    a, b, c = (corrupt(SMALL_PIXELS, flat(100, 24), s) for s in (seed, seed, seed + 1))
    assert a.tobytes() == b.tobytes()
    assert a.tobytes() != c.tobytes()
