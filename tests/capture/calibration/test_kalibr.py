"""Files in kalibr's form: written as PyYAML reads them, read strictly."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st

from grasp_factory.capture.calibration.document import read_document
from grasp_factory.capture.calibration.kalibr import (
    KalibrCamera,
    KalibrImu,
    read_camchain,
    read_imu,
    write_camchain,
    write_imu,
)
from grasp_factory.core.geometry import rotation_about, transform
from grasp_factory.errors import CaptureError, IrregularFileError, UsageError

IMU = KalibrImu(
    accelerometer_noise_density=1.86e-03,
    accelerometer_random_walk=4e-05,
    gyroscope_noise_density=1.87e-04,
    gyroscope_random_walk=2.66e-05,
    update_rate=200.0,
    rostopic="/imu0",
)
T = tuple(map(tuple, transform(rotation_about((0.6, 0.0, 0.8), 1.1), (0.1, 0.2, 0.3)).tolist()))
CAMERA = KalibrCamera(
    camera_model="pinhole",
    intrinsics=(605.0, 604.5, 320.25, 241.0),
    distortion_model="radtan",
    distortion_coeffs=(0.05, -0.1, 1e-3, -5e-4),
    resolution=(640, 480),
    rostopic="/cam0/image",
    T_cam_imu=T,
    timeshift_cam_imu=0.0021,
)
KALIBR_IMU = """\
#Accelerometers
accelerometer_noise_density: 1.86e-03   #Noise density (continuous-time)
accelerometer_random_walk:   4.33e-04   #Bias random walk

#Gyroscopes
gyroscope_noise_density:     1.87e-04
gyroscope_random_walk:       2.66e-05

rostopic:                    /imu0
update_rate:                 200.0
"""
KALIBR_CHAIN = """\
cam0:
  cam_overlaps: [1]
  camera_model: pinhole
  distortion_coeffs: [-0.2, 0.1, 0.0002, -4.5e-05]
  distortion_model: radtan
  intrinsics: [461.6, 460.3, 362.7, 246.0]
  resolution: [752, 480]
  rostopic: /cam0/image_raw
cam1:
  T_cn_cnm1:
  - [1.0, 0.0, 0.0, -0.11]
  - [0.0, 1.0, 0.0, 0.0]
  - [0.0, 0.0, 1.0, 0.0]
  - [0.0, 0.0, 0.0, 1.0]
  cam_overlaps: [0]
  camera_model: omni
  distortion_coeffs: [0.01, 0.02, 0.03, 0.04]
  distortion_model: equidistant
  intrinsics: [0.8, 833.0, 830.0, 373.0, 253.0]
  resolution: [752, 480]
  rostopic: /cam1/image_raw
"""


class TestImu:
    def test_what_is_written_is_read(self, tmp_path: Path) -> None:
        write_imu(tmp_path / "imu.yaml", IMU)
        assert read_imu(tmp_path / "imu.yaml") == IMU

    def test_plain_yaml_readers_get_numbers(self, tmp_path: Path) -> None:
        write_imu(tmp_path / "imu.yaml", IMU)
        data = yaml.safe_load((tmp_path / "imu.yaml").read_text())
        assert data["accelerometer_random_walk"] == 4e-05
        assert all(isinstance(v, float) for k, v in data.items() if k != "rostopic")
        assert set(data) == {
            *("accelerometer_noise_density", "accelerometer_random_walk", "rostopic"),
            *("gyroscope_noise_density", "gyroscope_random_walk", "update_rate"),
        }

    def test_kalibrs_own_input_and_output_are_read(self, tmp_path: Path) -> None:
        file = tmp_path / "imu.yaml"
        file.write_text(KALIBR_IMU)
        assert read_imu(file).gyroscope_random_walk == 2.66e-05
        rows = "\n".join(f"  - {list(row)}" for row in T)
        nested = "".join(f"  {line}\n" for line in KALIBR_IMU.splitlines())
        file.write_text(
            f"imu0:\n  T_i_b:\n{rows}\n{nested}  model: calibrated\n  time_offset: 0.0\n"
        )
        found = read_imu(file)
        assert (found.model, found.T_i_b) == ("calibrated", T)

    @pytest.mark.parametrize(
        ("change", "words"),
        [
            (("rostopic", "rostopik"), "unknown key 'rostopik'; did you mean 'rostopic'"),
            (("200.0", "0"), "update_rate: got 0.0, valid: 0.001 to 1000000.0 Hz"),
            (("1.86e-03", "-1.0"), "accelerometer_noise_density: got -1.0"),
            (("1.86e-03", ".nan"), "expected a finite number"),
            (("1.86e-03", "much"), "expected a number, got 'much'"),
            (("update_rate", "#"), "missing key 'update_rate'"),
        ],
    )
    def test_a_wrong_value_is_one_line_with_file_and_key(
        self, change: tuple[str, str], words: str, tmp_path: Path
    ) -> None:
        file = tmp_path / "imu.yaml"
        file.write_text(KALIBR_IMU.replace(*change))
        with pytest.raises(CaptureError) as found:
            read_imu(file)
        assert words in str(found.value)
        assert str(found.value).startswith(str(file))
        assert "\n" not in str(found.value)


class TestCamchain:
    def test_what_is_written_is_read(self, tmp_path: Path) -> None:
        write_camchain(tmp_path / "c.yaml", [CAMERA, CAMERA])
        assert read_camchain(tmp_path / "c.yaml") == (CAMERA, CAMERA)
        text = (tmp_path / "c.yaml").read_text()
        assert "intrinsics: [605.0, 604.5, 320.25, 241.0]" in text
        assert "&" not in text

    def test_kalibrs_own_chain_is_read(self, tmp_path: Path) -> None:
        (tmp_path / "c.yaml").write_text(KALIBR_CHAIN)
        first, second = read_camchain(tmp_path / "c.yaml")
        assert first.T_cn_cnm1 is None
        assert second.T_cn_cnm1 is not None
        assert second.T_cn_cnm1[0][3] == -0.11
        assert second.camera_model == "omni"

    @pytest.mark.parametrize(
        ("change", "words"),
        [
            (("cam1:", "cam2:"), "valid: cam0, cam1"),
            (("[752, 480]", "[752, 480, 3]"), "expected 2 values"),
            (("[752, 480]", "[752, 0]"), "two sides of 1 to 65536"),
            (("pinhole", "pinhol"), "camera_model: got 'pinhol'"),
            (("[461.6, 460.3, 362.7, 246.0]", "[461.6]"), "4 numbers for pinhole"),
            (("[1.0, 0.0, 0.0, -0.11]", "[2.0, 0.0, 0.0, -0.11]"), "T_cn_cnm1"),
            (("[0.0, 0.0, 0.0, 1.0]", "[0.0, 0.0, 0.5, 1.0]"), "T_cn_cnm1"),
            (("cam0:", "cam0: &a"), "is not valid YAML"),
        ],
    )
    def test_a_wrong_chain_is_one_line(
        self, change: tuple[str, str], words: str, tmp_path: Path
    ) -> None:
        text = KALIBR_CHAIN.replace(*change)
        (tmp_path / "c.yaml").write_text(text.replace("&a", "&a *a"))
        with pytest.raises(CaptureError) as found:
            read_camchain(tmp_path / "c.yaml")
        assert words in str(found.value)
        assert "\n" not in str(found.value)


class TestHostileFiles:
    @given(content=st.binary(max_size=300))
    def test_any_bytes_are_a_mapping_or_an_error_in_one_line(
        self, content: bytes, tmp_path_factory: pytest.TempPathFactory
    ) -> None:
        file = tmp_path_factory.getbasetemp() / "any.yaml"
        file.write_bytes(content)
        try:
            assert isinstance(read_document(file), dict)
        except CaptureError as error:
            assert "\n" not in str(error)

    def test_a_file_that_expands_is_refused(self, tmp_path: Path) -> None:
        lines = ["a0: &a0 [x, x, x, x, x, x, x, x, x]"]
        lines += [f"a{k}: &a{k} [{', '.join([f'*a{k - 1}'] * 9)}]" for k in range(1, 9)]
        (tmp_path / "bomb.yaml").write_text("\n".join(lines))
        with pytest.raises(CaptureError, match="more than 20000 values"):
            read_document(tmp_path / "bomb.yaml")

    def test_a_large_file_is_refused(self, tmp_path: Path) -> None:
        with (tmp_path / "large.yaml").open("wb") as file:
            file.truncate(2**40)
        with pytest.raises(CaptureError, match="valid: up to 1,000,000"):
            read_document(tmp_path / "large.yaml")

    def test_a_tag_makes_no_object(self, tmp_path: Path) -> None:
        (tmp_path / "tag.yaml").write_text("a: !!python/object/apply:os.system [true]")
        with pytest.raises(CaptureError, match="not valid YAML"):
            read_document(tmp_path / "tag.yaml")

    def test_a_link_and_a_pipe_are_refused(self, tmp_path: Path) -> None:
        write_imu(tmp_path / "imu.yaml", IMU)
        (tmp_path / "link.yaml").symlink_to(tmp_path / "imu.yaml")
        os.mkfifo(tmp_path / "pipe.yaml")
        for name in ("link.yaml", "pipe.yaml"):
            with pytest.raises(IrregularFileError):
                read_imu(tmp_path / name)

    def test_nothing_is_overwritten(self, tmp_path: Path) -> None:
        write_imu(tmp_path / "imu.yaml", IMU)
        with pytest.raises(UsageError, match="overwrites nothing"):
            write_imu(tmp_path / "imu.yaml", IMU)
        with pytest.raises(UsageError, match="does not exist"):
            write_imu(tmp_path / "no" / "imu.yaml", IMU)
        with pytest.raises(UsageError, match="cannot be read"):
            read_imu(tmp_path / "none.yaml")

    def test_numbers_survive_to_the_last_bit(self, tmp_path: Path) -> None:
        write_camchain(tmp_path / "c.yaml", [CAMERA])
        found = read_camchain(tmp_path / "c.yaml")[0].T_cam_imu
        assert np.array_equal(np.array(found), np.array(T))
