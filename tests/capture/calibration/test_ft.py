"""The zero of a force-torque sensor, refused under load or motion, and its identification."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation
from support.loaded_poses import COM, MASS, MATRIX, ZERO
from support.loaded_poses import loaded_poses as poses
from support.scale import scaled

from grasp_factory.capture.calibration.ft_calibration import (
    FtCalibration,
    identified,
    read_ft,
    read_poses,
    write_ft,
)
from grasp_factory.capture.calibration.load_identification import LoadedPose, identify_load
from grasp_factory.capture.calibration.tare import TareRule, tare_zero
from grasp_factory.errors import CaptureError, ConfigError

EYE, RULE = np.eye(6), TareRule()


def still(count: int = 200, seed: int = 0) -> np.ndarray:
    """Return readings of a Mini45 at rest without load."""
    std = np.array([1 / 16] * 3 + [1 / 752] * 3)
    return ZERO + std * np.random.default_rng(seed).standard_normal((count, 6))


class TestTare:
    def test_the_zero_is_the_mean_of_the_first_samples(self) -> None:
        raw = still()
        assert np.array_equal(tare_zero(raw, EYE, RULE), raw[:100].mean(axis=0))

    def test_a_tool_that_shakes_is_refused(self) -> None:
        raw = still()
        raw[:, 1] += 2.0 * np.sin(np.arange(200) / 3.0)
        with pytest.raises(CaptureError, match=r"moves: force y varies by 1\.4\d* N, valid: up to"):
            tare_zero(raw, EYE, RULE)

    def test_a_tool_that_is_lowered_slowly_is_refused(self) -> None:
        raw = still()
        raw[:, 5] += np.linspace(0.0, 0.04, 200)
        with pytest.raises(CaptureError, match="moves: torque z drifts by"):
            tare_zero(raw, EYE, RULE)

    def test_a_constant_load_is_refused_by_the_zero_from_before(self) -> None:
        raw = still() + np.array([0.0, 0.0, -5.0, 0.0, 0.0, 0.0])
        with pytest.raises(CaptureError, match=r"under load: force z is away from its zero by 5"):
            tare_zero(raw, EYE, RULE, ZERO)
        tare_zero(still(seed=2), EYE, RULE, ZERO)

    def test_the_bounds_hold_for_wrenches_not_for_raw_channels(self) -> None:
        raw = still() * 1000.0
        assert np.allclose(tare_zero(raw, EYE / 1000.0, RULE), raw[:100].mean(axis=0))
        with pytest.raises(CaptureError, match="moves"):
            tare_zero(raw, EYE, RULE)

    def test_few_or_broken_samples_are_refused(self) -> None:
        with pytest.raises(CaptureError, match="got 99 samples, valid: 100 or more"):
            tare_zero(still(99), EYE, RULE)
        raw = still()
        raw[3, 3] = np.nan
        with pytest.raises(CaptureError, match="not finite"):
            tare_zero(raw, EYE, RULE)


class TestIdentification:
    @settings(max_examples=scaled(10, 200), deadline=None)
    @given(seed=st.integers(0, 10_000))
    def test_matrix_zero_and_tool_are_found_exactly_without_noise(self, seed: int) -> None:
        found = identify_load(poses(40, seed=seed))
        assert np.allclose(found.matrix, MATRIX, atol=1e-6)
        assert np.allclose(found.zero, ZERO, atol=1e-4)
        assert found.tool_mass == pytest.approx(MASS, abs=1e-5)
        assert np.allclose(found.tool_com, COM, atol=1e-5)
        assert found.force_rms < 1e-6

    def test_with_noise_they_are_near(self) -> None:
        found = identify_load(poses(60, noise=0.05))
        assert np.abs(found.matrix - MATRIX).max() < 0.003
        assert found.tool_mass == pytest.approx(MASS, rel=0.03)
        assert found.force_rms < 0.02

    def test_a_known_matrix_needs_no_loads(self) -> None:
        found = identify_load(poses(6, has_loads=False), MATRIX)
        assert np.allclose(found.zero, ZERO)
        assert found.tool_mass == pytest.approx(MASS)
        assert np.allclose(found.tool_com, COM)

    def test_poses_that_leave_a_value_open_are_refused(self) -> None:
        with pytest.raises(CaptureError, match="without a known load"):
            identify_load(poses(40, has_loads=False))
        with pytest.raises(CaptureError, match="leave a value open"):
            identify_load(poses(6))
        with pytest.raises(CaptureError, match="leave a value open"):
            identify_load(poses(1, has_loads=False) * 8, MATRIX)

    def test_a_tool_without_weight_has_no_centre(self) -> None:
        bare = [LoadedPose(quat_xyzw=tuple(R.as_quat()), raw=tuple(ZERO))
                for R in Rotation.random(6, rng=np.random.default_rng(0))]  # fmt: skip
        found = identify_load(bare, EYE)
        assert found.tool_mass == pytest.approx(0.0, abs=1e-9)
        assert np.isnan(found.tool_com).all()


class TestFiles:
    def test_what_is_written_is_read(self, tmp_path: Path) -> None:
        calibration = FtCalibration(zero=tuple(ZERO), tool_mass=0.4, frame="tcp")
        write_ft(tmp_path / "ft.yaml", calibration)
        assert read_ft(tmp_path / "ft.yaml") == calibration

    def test_a_matrix_without_inverse_is_refused(self) -> None:
        with pytest.raises(ConfigError, match="with an inverse"):
            FtCalibration(matrix=tuple(map(tuple, np.ones((6, 6)).tolist())))

    def test_poses_in_a_csv_file_give_the_calibration(self, tmp_path: Path) -> None:
        file = tmp_path / "poses.csv"
        head = "qx,qy,qz,qw,c0,c1,c2,c3,c4,c5,load_mass,load_x,load_y,load_z"
        rows = [
            ",".join(map(repr, map(float, (*p.quat_xyzw, *p.raw, p.load_mass, *p.load_com))))
            for p in poses(40)
        ]
        file.write_text("\n".join([head, *rows]))
        calibration, _ = identified(file, None)
        assert np.allclose(calibration.matrix, MATRIX, atol=1e-6)
        wrench = calibration.wrench(np.array([ZERO]))
        assert np.abs(wrench).max() < 1e-4

    @pytest.mark.parametrize(
        ("text", "words"),
        [
            ("qx,qy,qz\n", "no column qw"),
            ("qx,qy,qz,qw,c0,c1,c2,c3,c4,c5\n1,2", "line 2: got"),
            ("qx,qy,qz,qw,c0,c1,c2,c3,c4,c5\n", "got 0 poses"),
            ("qx,qy,qz,qw,c0,c1,c2,c3,c4,c5\n0,0,0,2,1,1,1,1,1,1\n", "quaternions of length 1"),
            ("qx,qy,qz,qw,c0,c1,c2,c3,c4,c5\n0,0,0,1,,1,1,1,1,1\n", "empty or not finite"),
            ("\xff\x00", "no column qx"),
        ],
    )
    def test_a_wrong_csv_file_is_one_line(self, text: str, words: str, tmp_path: Path) -> None:
        (tmp_path / "poses.csv").write_text(text)
        with pytest.raises(CaptureError, match=words) as found:
            read_poses(tmp_path / "poses.csv")
        assert "\n" not in str(found.value)
