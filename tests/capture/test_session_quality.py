"""The quality of a session: each measure sees what it is for, and the score follows from them."""

from __future__ import annotations

import dataclasses
import json
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from numpy.typing import NDArray
from support.faces import portrait
from support.sessions import SessionMaker

from grasp_factory.capture.quality.image_series import ImageMeasures
from grasp_factory.capture.quality.imu_noise import noise_densities, static_samples
from grasp_factory.capture.quality.noisy_sharpness import noisy_sharpness
from grasp_factory.capture.quality.session_check import check_session, nominal_rate
from grasp_factory.capture.quality.session_quality import (
    SESSION_CRITERIA,
    SessionInspection,
    SessionQualityConfig,
)
from grasp_factory.capture.quality.streams import (
    longest_gap,
    lost_share,
    measured_rate,
    saturated_share,
)
from grasp_factory.capture.quality.sync_spread import host_times, sync_spread
from grasp_factory.core.serialization import from_plain, to_plain
from grasp_factory.errors import CaptureError, ConfigError
from grasp_factory.labels.image_metrics import grey, sharpness

Run = Callable[..., tuple[int, str, str]]
RATE = 400.0
FORCE, ANGULAR = 0.0017, 0.00024
"""Noise densities of a BMI088, m/s2/sqrt(Hz) and rad/s/sqrt(Hz)."""
CALIBRATION = f"accelerometer_noise_density: {FORCE}\ngyroscope_noise_density: {ANGULAR}\n"
USUAL = SessionQualityConfig()
GOOD = SessionInspection(
    sharpness=0.6,
    exposure=0.5,
    clipped=0.0,
    frozen=0.0,
    stream_gap=1.0,
    lost=0.0,
    accelerometer_noise=1.0,
    gyroscope_noise=1.0,
    saturated=0.0,
    sync_spread=0.0,
)


def ticks(count: int, rate: float) -> NDArray[np.int64]:
    return np.rint(np.arange(count) * 1e9 / rate).astype(np.int64)


def at_rest(count: int, factor: float = 1.0) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return specific force and angular velocity of an IMU that lies still."""
    rng = np.random.default_rng(1)
    force = rng.normal((0.1, -0.2, 9.8), factor * FORCE * math.sqrt(RATE), (count, 3))
    angular = rng.normal((0.01, 0, -0.01), factor * ANGULAR * math.sqrt(RATE), (count, 3))
    return force, angular


def pictures(count: int) -> list[NDArray[np.uint8]]:
    """Return images of sharp squares."""
    rng = np.random.default_rng(2)
    small = [rng.integers(60, 190, (6, 8, 3), np.uint8) for _ in range(count)]
    return [np.kron(each, np.ones((8, 8, 1), np.uint8)) for each in small]


def good_session(**more: Any) -> SessionMaker:
    maker = SessionMaker(calibration={"imu.yaml": CALIBRATION}, **more)
    rng = np.random.default_rng(3)
    maker.camera(pictures(30)).imu(*at_rest(400), RATE, clock=1.00005)
    return maker.wrench(rng.normal(size=(1000, 6)), 1000.0)


def test_a_good_session_has_the_best_score(tmp_path: Path, run: Run) -> None:
    folder = good_session().write(tmp_path / "in")
    found = check_session(folder)
    assert (found.score, found.shortcomings) == (5, ())
    assert found.inspection.accelerometer_noise == pytest.approx(1.0, abs=0.15)
    assert found.inspection.gyroscope_noise == pytest.approx(1.0, abs=0.15)
    assert {stream.topic: round(stream.rate) for stream in found.streams} == {
        "/cam/image": 30,
        "/ft/wrench": 1000,
        "/imu/imu": 400,
    }
    code, out, err = run("capture", "check", folder)
    assert code == 0, err
    assert out.splitlines()[-1] == f"{folder}: quality 5 of 5, very good"
    assert "30 Hz" in out


def test_a_missed_tolerance_is_named_and_ends_with_1(tmp_path: Path, run: Run) -> None:
    maker = good_session()
    kept = [m for m in maker.messages if not 100 < m.sequence < 120 or m.channel.device != "imu"]
    folder = dataclasses.replace(maker, messages=kept).write(tmp_path / "in")
    code, out, _ = run("capture", "check", folder)
    assert code == 1
    assert "missed: stream_gap 20, valid: at most 3 (max_stream_gap)" in out
    assert "missed: lost 0.0475, valid: at most 0.01 (max_lost)" in out
    assert "missed: sync_spread 0.0" in out
    assert f"{folder}: quality 3 of 5, fair" in out
    code, out, _ = run("capture", "check", folder, "--json")
    data = json.loads(out)
    assert (code, data["score"], len(data["shortcomings"])) == (1, 3, 3)


def test_json_has_null_for_what_cannot_be_known(tmp_path: Path, run: Run) -> None:
    folder = SessionMaker().joints(np.zeros((20, 7)), 100.0).write(tmp_path / "in")
    code, out, _ = run("capture", "check", folder, "--json")
    assert code == 0
    assert json.loads(out)["inspection"]["sharpness"] is None


def test_a_session_without_samples_has_no_quality(tmp_path: Path, run: Run) -> None:
    folder = SessionMaker().event("start").write(tmp_path / "in")
    code, out, err = run("capture", "check", folder)
    assert (code, out) == (1, "")
    assert "has no samples of a device: there is nothing to check" in err


def test_without_a_count_the_rate_of_the_settings_tells_what_is_lost(tmp_path: Path) -> None:
    values = np.random.default_rng(0).normal(size=(501, 6))
    folder = SessionMaker(settings={"devices": {"ft": {"rate_hz": 1000}}})
    found = check_session(folder.wrench(values, 500.0).write(tmp_path / "in"))
    assert found.inspection.lost == pytest.approx(0.5, abs=0.01)
    assert found.inspection.stream_gap == pytest.approx(2.0)


@pytest.mark.parametrize("rate", [None, "fast", True, -1, 0, math.inf, {}])
def test_a_rate_that_is_none_is_unknown(rate: Any) -> None:
    assert math.isnan(nominal_rate({"devices": {"ft": {"rate_hz": rate}}}, "ft"))
    assert math.isnan(nominal_rate({"devices": rate}, "ft"))


@given(st.integers(2, 60), st.data())
def test_lost_samples_are_counted_by_the_device(count: int, data: st.DataObject) -> None:
    lost = data.draw(st.sets(st.integers(1, count - 2), max_size=count - 2) if count > 2 else
                     st.just(set()))  # fmt: skip
    kept = np.array([k for k in range(count) if k not in lost])
    times = ticks(count, 100.0)[kept]
    assert lost_share(times, kept + 2**32, None) == pytest.approx(len(lost) / count)
    assert lost_share(times, None, 100.0) == pytest.approx(len(lost) / count)
    assert measured_rate(times, kept) == pytest.approx(100.0)
    gap = int(np.diff(kept).max())
    assert longest_gap(times, 100.0) == pytest.approx(gap)


def test_times_that_go_back_are_an_infinite_gap() -> None:
    assert longest_gap(np.array([0, 10, 5]), 1.0) == math.inf
    assert math.isnan(longest_gap(np.array([0]), 1.0))
    assert math.isnan(lost_share(np.array([0, 1]), None, None))
    assert math.isnan(measured_rate(np.array([], np.int64), None))


def test_a_flat_top_is_saturation_and_noise_is_not() -> None:
    wave = 30 * np.sin(np.arange(1000) / 50)
    clipped = np.clip(wave, -20, 20).reshape(-1, 1)
    expected = float((np.abs(wave) >= 20).mean())
    assert saturated_share(clipped) == pytest.approx(expected, abs=0.01)
    assert saturated_share(clipped, np.array([20.0])) == pytest.approx(expected, abs=0.01)
    assert saturated_share(wave.reshape(-1, 1), np.array([20.0])) == pytest.approx(
        expected, abs=0.02
    )
    assert saturated_share(wave.reshape(-1, 1)) == 0.0
    rounded = np.round(np.random.default_rng(0).normal(size=(5000, 3)))
    assert saturated_share(rounded) == 0.0
    assert saturated_share(np.zeros((50, 6))) == 0.0
    assert math.isnan(saturated_share(np.empty((0, 6))))


@given(hnp.arrays(np.float64, st.tuples(st.integers(1, 40), st.integers(1, 6))))
def test_any_values_have_a_share_of_saturation(values: NDArray[np.float64]) -> None:
    with np.errstate(all="ignore"):
        assert 0.0 <= saturated_share(values) <= 1.0


@pytest.mark.parametrize("factor", [1.0, 5.0, 20.0])
def test_the_noise_of_an_imu_at_rest_is_measured(factor: float) -> None:
    found = noise_densities(*at_rest(4000, factor), RATE)
    assert found.accelerometer / FORCE == pytest.approx(factor, rel=0.05)
    assert found.gyroscope / ANGULAR == pytest.approx(factor, rel=0.05)


def test_motion_is_left_out_of_the_noise() -> None:
    force, angular = at_rest(4000)
    t = np.arange(2000) / RATE
    angular[1000:3000, 1] += 0.8 * np.sin(2 * np.pi * 0.7 * t)
    force[1000:3000, 0] += 3.0 * np.sin(2 * np.pi * 2.0 * t)
    still = static_samples(force, angular, RATE)
    assert still[:1000].mean() > 0.9
    assert still[3000:].mean() > 0.9
    assert still[1000:3000].mean() < 0.1
    assert noise_densities(force, angular, RATE).accelerometer / FORCE == pytest.approx(1, rel=0.1)


def test_an_imu_that_turns_steadily_is_not_at_rest() -> None:
    force, angular = at_rest(4000)
    angular[:2000] += 0.5
    angular[3000:] += 0.5
    assert not static_samples(force, angular, RATE)[2000:3000].all()
    assert all(math.isnan(value) for value in noise_densities(force[:10], angular[:10], RATE))


def test_a_noisy_imu_is_told_by_its_calibration(tmp_path: Path) -> None:
    maker = SessionMaker(calibration={"imu.yaml": CALIBRATION + "rostopic: /imu/imu\n"})
    found = check_session(maker.imu(*at_rest(800, 6.0), RATE).write(tmp_path / "in"))
    assert found.inspection.accelerometer_noise == pytest.approx(6.0, rel=0.1)
    assert len(found.shortcomings) == 2
    maker = SessionMaker(calibration={"imus.yaml": "imu0:\n  " + CALIBRATION.replace("\n", "\n  ")})
    other = check_session(maker.imu(*at_rest(800, 6.0), RATE).write(tmp_path / "other"))
    assert other.inspection == found.inspection


def test_calibrations_that_are_large_together_are_refused(tmp_path: Path) -> None:
    files = {f"{k}.yaml": "a: 1\n" + "# much\n" * 20_000 for k in range(2)}
    folder = SessionMaker(calibration=files).event("start").write(tmp_path / "in")
    with pytest.raises(CaptureError, match=r"its YAML files have more than 262\.1 kB"):
        check_session(folder)


@pytest.mark.parametrize("value", ["x", "-1", "0", ".nan", "true"])
def test_a_calibration_that_is_no_noise_is_refused(tmp_path: Path, value: str) -> None:
    text = f"accelerometer_noise_density: {value}\ngyroscope_noise_density: 1\n"
    folder = SessionMaker(calibration={"imu.yaml": text}).event("start").write(tmp_path / "in")
    with pytest.raises(CaptureError, match="accelerometer_noise_density"):
        check_session(folder)


def test_images_are_measured_by_blur_light_and_repetition() -> None:
    sharp, soft, dark = ImageMeasures(), ImageMeasures(), ImageMeasures()
    for image in pictures(12):
        sharp.add(image)
        soft.add(np.asarray(cv2.GaussianBlur(portrait(), (0, 0), 3), np.uint8))
        dark.add(image // 60)
    assert min(sharp.sharpness) > 0.5 > USUAL.min_sharpness > max(soft.sharpness)
    assert max(dark.exposure) < USUAL.min_exposure
    assert min(dark.clipped) > USUAL.max_clipped
    assert sharp.frozen == 0
    still = pictures(1) * 4 + pictures(3) + pictures(1) * 6
    frozen = ImageMeasures()
    for image in still:
        frozen.add(image)
    assert frozen.frozen == 5


@pytest.mark.parametrize("noise", [0, 1, 2, 5])
def test_noise_is_not_taken_for_sharpness(noise: float) -> None:
    rng = np.random.default_rng(0)

    def seen(blur: float) -> float:
        soft = cv2.GaussianBlur(portrait(), (0, 0), blur) if blur else portrait()
        values = np.clip(soft + rng.normal(0, noise, soft.shape), 0, 255).astype(np.uint8)
        return noisy_sharpness(grey(values))

    assert seen(0.0) == pytest.approx(0.86, abs=0.02)
    assert seen(0.7) == pytest.approx(0.68, abs=0.03)
    assert seen(2.5) < USUAL.min_sharpness
    if not noise:
        assert seen(1.0) == pytest.approx(
            sharpness(grey(np.asarray(cv2.GaussianBlur(portrait(), (0, 0), 1.0)))), abs=0.03
        )


def test_an_image_without_edges_is_not_sharp() -> None:
    flat = np.full((40, 50), 90, np.uint8)
    noisy = np.random.default_rng(0).normal(90, 3, (40, 50)).astype(np.uint8)
    assert noisy_sharpness(flat) == noisy_sharpness(noisy) == noisy_sharpness(flat[:1]) == 0.0


def test_the_spread_is_what_the_period_does_not_explain() -> None:
    imu = ticks(4000, RATE)
    images = ticks(290, 30.0) + 500_000_000
    assert sync_spread(images, imu, RATE) < 1e-6
    assert sync_spread(images[:5] + 10**12, imu, RATE) != 0.0  # there is none
    gap = np.concatenate([imu[:1000], imu[2000:]])
    assert sync_spread(images, gap, RATE) > 0.5
    assert math.isnan(sync_spread(images, imu[:0], math.nan))


def test_batches_and_drift_do_not_count_as_spread() -> None:
    true = ticks(8000, RATE)
    rng = np.random.default_rng(0)
    arrived = (true // 16_000_000 + 1) * 16_000_000 + rng.exponential(2e5, 8000).astype(np.int64)
    device = 7_000_000_000 + np.rint(true * 1.0003).astype(np.int64)
    found = host_times(arrived, device)
    error = found - true
    assert np.ptp(error) < 1_000_000
    assert np.array_equal(host_times(arrived, None), arrived)
    back = device.copy()
    back[5] = back[4]
    assert np.array_equal(host_times(arrived, back), arrived)


CHANGES = {
    "sharpness": 0.01,
    "exposure": 0.95,
    "clipped": 0.5,
    "frozen": 10.0,
    "stream_gap": 9.0,
    "lost": 0.2,
    "accelerometer_noise": 9.0,
    "gyroscope_noise": 9.0,
    "saturated": 0.1,
    "sync_spread": 0.01,
}


@pytest.mark.parametrize("name", CHANGES)
def test_each_missed_criterion_takes_a_point(name: str) -> None:
    assert GOOD.score(USUAL) == 5
    bad = dataclasses.replace(GOOD, **{name: CHANGES[name]})
    assert bad.score(USUAL) == 4
    (text,) = bad.shortcomings(USUAL)
    assert text.startswith(name)


def test_a_score_is_at_least_1_and_what_is_unknown_is_no_fault() -> None:
    assert SessionInspection(**CHANGES).score(USUAL) == 1
    nothing = SessionInspection(**dict.fromkeys(CHANGES, math.nan))
    assert (nothing.score(USUAL), nothing.shortcomings(USUAL)) == (5, ())


def test_criteria_are_measured_and_have_thresholds() -> None:
    assert {c.column for c in SESSION_CRITERIA} == set(to_plain(GOOD)) == set(CHANGES)
    assert {c.threshold for c in SESSION_CRITERIA} | {"min_score"} == set(to_plain(USUAL))


@pytest.mark.parametrize(
    ("key", "value"),
    [("max_lost", 2), ("min_exposure", 0.95), ("min_score", 6), ("max_frozen", "x")],
)
def test_a_threshold_out_of_range_is_refused(key: str, value: Any) -> None:
    with pytest.raises(ConfigError, match=key):
        from_plain(SessionQualityConfig, {key: value}, "quality")
