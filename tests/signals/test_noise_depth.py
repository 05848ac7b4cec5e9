"""Depth noise against its model: flat walls, whose every pixel's depth and slant is known."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from grasp_factory.core.geometry import Array
from grasp_factory.errors import UsageError
from grasp_factory.signals.noise import STEREO, STRUCTURED_LIGHT
from grasp_factory.signals.noise.depth import corrupt
from grasp_factory.signals.noise.occlusion import bends, incidence, shadow

K = np.array([[580.0, 0.0, 320.0], [0.0, 580.0, 239.0], [0.0, 0.0, 1.0]])
FAR = 50.0
MIDDLE = (slice(60, 420), slice(260, 380))
PRESETS = {"structured_light": STRUCTURED_LIGHT, "stereo": STEREO}
IDEAL = dataclasses.replace(
    STEREO, axial_growth=0.0, disparity_step=0.0, lateral=0.0, edge_loss=0.0,
    grazing_loss=(1.5, 1.5), reach=(0.0, FAR),
)  # fmt: skip
DISTANCES = (0.3, 0.4, 0.52, 0.6, 0.75, 1.0, 1.37, 2.0, 2.5, 3.0)


def wall(z: float, tilt: float = 0.0, turn: float = 0.0) -> tuple[Array, Array]:
    """Return a wall's depth (H, W), z at the centre, and the angle of incidence, by ray casting."""
    v, u = np.indices((480, 640))
    ray = np.stack([(u - 320.0) / 580.0, (v - 239.0) / 580.0, np.ones(u.shape)], axis=-1)
    normal = np.array([
        math.sin(tilt) * math.cos(turn), math.sin(tilt) * math.sin(turn), math.cos(tilt)
    ])  # fmt: skip
    cosine = ray @ normal / np.linalg.norm(ray, axis=-1)
    return (z * normal[2] / (ray @ normal)).astype(np.float32), np.arccos(cosine)


def kinect(z: Array, theta: Array) -> Array:
    """Return the axial noise of Nguyen, Izadi & Lovell 2012, equation 3."""
    return 0.0012 + 0.0019 * (z - 0.4) ** 2 + 0.0001 / z**0.5 * (theta / (np.pi / 2 - theta)) ** 2


def realsense(z: Array, theta: Array) -> Array:
    """Return Intel's formula for the D435 at 848x480, in its own unit: millimetres."""
    focal_length = 0.5 * 848 / math.tan(math.radians(90) / 2)
    return (1000 * z) ** 2 * 0.08 / (focal_length * 50) / 1000


PUBLISHED = {"structured_light": kinect, "stereo": realsense}


class TestFlatWall:
    @pytest.mark.parametrize("z", DISTANCES)
    @pytest.mark.parametrize("name", PRESETS)
    def test_facing_the_camera_the_spread_follows_the_published_curve(
        self, name: str, z: float
    ) -> None:
        noise = PRESETS[name]
        if z < noise.reach[0]:
            assert not corrupt(noise, wall(z)[0], K, FAR, 0).any()
            return
        measured = corrupt(noise, wall(z)[0], K, FAR, 0)[MIDDLE]
        assert (measured > 0.0).all()
        expected = PUBLISHED[name](np.array(z), np.array(0.0))
        assert measured.std() == pytest.approx(expected, rel=0.1)
        assert measured.mean() == pytest.approx(z, abs=0.05 * expected + 1e-5)

    @pytest.mark.parametrize("tilt_deg", [20, 45, 60, 70])
    @pytest.mark.parametrize("z", [0.7, 1.0, 2.0, 3.0])
    @pytest.mark.parametrize("name", PRESETS)
    def test_tilted_the_spread_about_its_plane_follows_the_published_curve(
        self, name: str, z: float, tilt_deg: float
    ) -> None:
        depth, theta = wall(z, math.radians(tilt_deg))
        measured = corrupt(PRESETS[name], depth, K, FAR, 1)[MIDDLE]
        expected = PUBLISHED[name](depth[MIDDLE], theta[MIDDLE])
        known = measured > 0.0
        assert known.mean() > 0.95
        assert ((measured - depth[MIDDLE]) / expected)[known].std() == pytest.approx(1.0, rel=0.1)

    @given(st.floats(0.55, 3.0), st.floats(0.0, 1.2), st.floats(0.0, 6.28))
    def test_at_any_distance_and_slant_the_spread_is_the_models_sigma(
        self, z: float, tilt: float, turn: float
    ) -> None:
        depth, theta = wall(z, tilt, turn)
        for noise in PRESETS.values():
            measured = corrupt(noise, depth, K, FAR, 2)[MIDDLE]
            error = (measured - depth[MIDDLE]) / noise.sigma(depth[MIDDLE], theta[MIDDLE])
            assert error[measured > 0.0].std() == pytest.approx(1.0, rel=0.1)

    def test_stereo_noise_is_smooth_over_the_image_and_structured_lights_is_not(self) -> None:
        for noise, low, high in ((STRUCTURED_LIGHT, -0.05, 0.05), (STEREO, 0.8, 1.0)):
            error = corrupt(noise, wall(1.0)[0], K, FAR, 3)[MIDDLE] - 1.0
            neighbors = np.corrcoef(error[:, :-1].ravel(), error[:, 1:].ravel())[0, 1]
            assert low < neighbors < high

    def test_depths_lie_on_the_sensors_counts_of_disparity(self) -> None:
        measured = corrupt(STRUCTURED_LIGHT, wall(2.0)[0], K, FAR, 4)[MIDDLE].astype(np.float64)
        counts = 586.0 * 0.075 / measured * 8
        np.testing.assert_allclose(counts, np.round(counts), atol=1e-4)
        # Khoshelham & Elberink 2012: the steps are 2.85e-5 z^2 cm.
        assert STRUCTURED_LIGHT.count(2.0) == pytest.approx(1e-2 * 2.85e-5 * 200**2, rel=0.01)


class TestDropouts:
    def test_an_ideal_camera_shows_the_depth(self) -> None:
        depth, _ = wall(1.0, 0.5)
        np.testing.assert_allclose(corrupt(IDEAL, depth, K, FAR, 0), depth, rtol=1e-6)

    def test_nothing_seen_and_out_of_reach_is_zero(self) -> None:
        depth, _ = wall(1.0)
        depth[:, :100], depth[:, 500:], depth[:50, 200:300] = 4.0, 0.05, np.nan
        near_and_far = dataclasses.replace(IDEAL, reach=STEREO.reach, baseline=0.001)
        measured = corrupt(near_and_far, depth, K, 4.0, 0)
        assert not measured[:, :100].any()
        assert not measured[:, 500:].any()
        assert not measured[:50, 200:300].any()
        assert measured[200:, 200:300].all()

    def test_the_shadow_of_a_near_thing_lies_left_of_it_and_is_as_wide_as_geometry_says(
        self,
    ) -> None:
        depth, _ = wall(1.0)
        depth[200:300, 300:400] = 0.5
        lost = corrupt(IDEAL, depth, K, FAR, 0) == 0.0
        width = 580.0 * 0.05 * (1 / 0.5 - 1 / 1.0)  # f B (1/near - 1/far)
        assert np.abs(lost[200:300].sum(axis=1) - width).max() <= 1.0
        assert lost[200:300, 301 - round(width) : 300].all()
        assert not lost[:200].any()

    @given(st.floats(0.0, 1.4), st.floats(0.0, 6.28), st.floats(0.3, 5.0))
    def test_a_plane_has_no_edge_no_shadow_and_its_own_slant(
        self, tilt: float, turn: float, z: float
    ) -> None:
        depth, theta = wall(z, tilt, turn)
        inverse = (1.0 / depth)[100:380, 200:440]  # where no such plane comes to its horizon
        assert bends(inverse).max() * 20.0 < 1e-3
        if tilt < 1.2:
            assert not shadow(inverse, 29.0).any()
        shifted = K.copy()
        shifted[:2, 2] -= [200, 100]
        ahead = theta[100:380, 200:440] < 1.45
        found = incidence(np.asarray(inverse, np.float32), shifted)
        np.testing.assert_allclose(found[ahead], theta[100:380, 200:440][ahead], atol=0.02)

    def test_more_is_lost_the_more_grazing_the_light(self) -> None:
        shares = []
        for tilt in (70, 78, 82, 88):
            depth, _ = wall(1.0, math.radians(tilt), math.pi / 2)
            middle = corrupt(STEREO, depth, K, FAR, 0)[229:249, 310:330]
            shares.append((middle == 0.0).mean())
        assert shares[0] == 0.0
        assert shares == sorted(shares)
        assert shares[-1] == 1.0

    def test_pixels_beside_an_edge_look_at_either_side_and_part_of_them_at_nothing(self) -> None:
        depth, _ = wall(1.0)
        depth[240:] = 0.8  # a horizontal edge casts no shadow
        noise = dataclasses.replace(IDEAL, lateral=2.0, edge_loss=0.3)
        measured = corrupt(noise, depth, K, FAR, 0)
        band = measured[238:242]
        assert set(np.unique(measured).astype(float).round(5)) == {0.0, 0.8, 1.0}
        assert (band == 0.0).mean() == pytest.approx(0.3, abs=0.05)
        assert (np.abs(band[:2] - 0.8) < 1e-3).any()
        assert (np.abs(band[2:] - 1.0) < 1e-3).any()
        np.testing.assert_allclose(measured[:220], 1.0, rtol=1e-6)

    def test_an_image_with_half_the_focal_length_frays_half_as_wide(self) -> None:
        depth, _ = wall(1.0)
        depth[240:] = 0.8
        noise = dataclasses.replace(IDEAL, lateral=4.0, edge_loss=1.0)
        widths = []
        for scale in (1.0, 0.5):
            small = K * [[scale], [scale], [1.0]]
            widths.append((corrupt(noise, depth, small, FAR, 0)[:, 320] == 0.0).sum())
        assert widths[0] == pytest.approx(2 * widths[1], abs=2)


class TestSeeds:
    @given(st.integers(0, 2**32 - 1))
    def test_the_same_seed_gives_the_same_image_and_another_another(self, seed: int) -> None:
        depth = wall(1.0)[0][:40, :50]
        a, b, c = (corrupt(STEREO, depth, K, FAR, s) for s in (seed, seed, seed + 1))
        assert a.dtype == np.float32
        assert a.tobytes() == b.tobytes()
        assert a.tobytes() != c.tobytes()

    def test_what_it_is_given_stays_as_it_is(self) -> None:
        depth, _ = wall(1.0)
        corrupt(STEREO, depth, K, FAR, 0)
        np.testing.assert_array_equal(depth, wall(1.0)[0])


@pytest.mark.parametrize(
    ("field", "value"), [("axial_floor", -1e-3), ("reach", (0.3, -1.0)), ("lateral", math.nan)]
)
def test_a_negative_figure_is_refused(field: str, value: object) -> None:
    with pytest.raises(UsageError, match=f"DepthNoise: {field} .*: valid: 0 or more"):
        dataclasses.replace(STEREO, **{field: value})
