"""The calibration of an inertial sensor from recordings: CSV files, sessions, damaged ones."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest
from support import bags
from support.inertial_records import GYRO_BIAS, MATRIX, positions_record, still_record, write_csv
from support.scale import scaled

from grasp_factory.capture.calibration.imu_calibrating import (
    ImuSources,
    calibrate_imu,
    write_imu_calibration,
)
from grasp_factory.capture.calibration.imu_model_file import ImuModel, read_imu_model
from grasp_factory.capture.calibration.kalibr import read_imu
from grasp_factory.capture.calibration.series_source import SeriesJob, read_series, series_in
from grasp_factory.capture.calibration.still_positions import still_positions
from grasp_factory.errors import CaptureError, GraspFactoryError, UsageError
from grasp_factory.signals import BMI088

RATE = 100.0


@pytest.fixture(scope="module")
def records(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("records")
    write_csv(folder / "still.csv", *still_record(seconds=120.0, rate_hz=RATE))
    write_csv(folder / "turned.csv", *positions_record(count=16, rate_hz=RATE, aligned=False))
    write_csv(folder / "six.csv", *positions_record(count=6, rate_hz=RATE, aligned=True))
    return folder


class TestCalibration:
    def test_a_record_at_rest_gives_noise_and_bias(self, records: Path, tmp_path: Path) -> None:
        found = calibrate_imu(ImuSources(still=records / "still.csv"))
        assert found.rate_hz == pytest.approx(RATE)
        truth = BMI088.gyroscope.noise_density[0]
        assert [a.density for a in found.gyroscope] == pytest.approx([truth] * 3, rel=0.1)
        assert found.model.gyroscope.bias == pytest.approx(GYRO_BIAS, abs=2e-4)
        assert found.has_temperature
        assert found.model.gyroscope.temperature_slope[0] == pytest.approx(1e-4, abs=2e-5)
        write_imu_calibration(found, tmp_path / "out")
        assert read_imu(tmp_path / "out/imu.yaml") == found.noise
        assert read_imu_model(tmp_path / "out/imu_model.yaml") == found.model
        picture = cv2.imread(str(tmp_path / "out/allan.png"))
        assert picture is not None
        assert picture.shape == (560, 1200, 3)
        assert picture.std() > 10.0
        assert [path.name for path in tmp_path.iterdir()] == ["out"]

    @pytest.mark.parametrize("name", ["turned", "six"])
    def test_positions_give_scale_and_axes(self, name: str, records: Path) -> None:
        found = calibrate_imu(
            ImuSources(
                still=records / "still.csv",
                positions=records / f"{name}.csv",
                aligned=name == "six",
            )
        )
        assert np.abs(np.array(found.model.accelerometer.matrix) - MATRIX).max() < 1e-3
        assert found.position_fit is not None
        assert found.position_fit.rms < 0.01

    def test_a_sensor_that_moves_has_no_noise_figures(self, records: Path) -> None:
        with pytest.raises(CaptureError, match="the sensor moves: specific force varies by"):
            calibrate_imu(ImuSources(still=records / "turned.csv"))

    def test_an_existing_folder_is_left_alone(self, records: Path, tmp_path: Path) -> None:
        found = calibrate_imu(ImuSources(still=records / "still.csv"))
        (tmp_path / "out").mkdir()
        with pytest.raises(UsageError, match="overwrites nothing"):
            write_imu_calibration(found, tmp_path / "out")
        assert list((tmp_path / "out").iterdir()) == []


class TestPositions:
    def test_each_stay_is_one_position(self) -> None:
        _, values, _ = positions_record(count=11, rate_hz=RATE, aligned=False)
        assert len(still_positions(values[:, :3], RATE)) == 11

    def test_a_sensor_that_never_lies_still_has_none(self) -> None:
        noise = np.random.default_rng(0).normal(0.0, 3.0, (2000, 3))
        drift = np.cumsum(noise, axis=0)
        with pytest.raises(CaptureError, match="never lay still"):
            still_positions(drift, RATE)


class TestSources:
    def test_a_session_and_a_csv_file_give_the_same_series(
        self, records: Path, tmp_path: Path
    ) -> None:
        expected = read_series(records / "six.csv", "imu")
        times = np.round(expected.times[:200] * 1e9).astype(int) + 10**18
        contents = [
            ("/imu/imu", bags.IMU, int(t), {"stamp": int(t), **imu_fields(row)})
            for t, row in zip(times, expected.values[:200], strict=True)
        ]
        folder = bags.mcap(tmp_path / "bag", contents)
        session = tmp_path / "session"
        session.mkdir()
        next(folder.glob("*.mcap")).rename(session / "session.mcap")
        for source in (session, session / "session.mcap"):
            found = read_series(source, "imu")
            assert np.array_equal(found.values, expected.values[:200])
            assert np.allclose(found.times - 1e9, expected.times[:200], atol=1e-6)
        with pytest.raises(UsageError, match=r"no topic /imo .*; it has: /imu/imu"):
            read_series(session, "imu", "/imo")
        with pytest.raises(UsageError, match="WrenchStamped: none; choose one with --topic"):
            read_series(session, "wrench")

    def test_a_session_with_flipped_bytes_is_read_or_an_error_in_one_line(
        self, tmp_path: Path
    ) -> None:
        contents = [
            ("/imu/imu", bags.IMU, 10**18 + k, {"stamp": 10**18 + k, **imu_fields(np.arange(6.0))})
            for k in range(20)
        ]
        whole = next(bags.mcap(tmp_path / "bag", contents).glob("*.mcap")).read_bytes()
        rng, file = np.random.default_rng(0), tmp_path / "x.mcap"
        failed = 0
        for _ in range(scaled(20, 5000)):
            data = bytearray(whole)
            for place in rng.integers(len(data), size=4):
                data[place] = rng.integers(256)
            file.write_bytes(data[: rng.integers(len(data) // 2, 2 * len(data))])
            try:
                series_in(SeriesJob(source=file, kind="imu", topic=""), lambda _: None)
            except GraspFactoryError as error:
                failed += 1
                assert "\n" not in str(error)
            except MemoryError:  # which the process with limits turns into a LimitError
                failed += 1
        assert failed > 4

    @pytest.mark.parametrize("name", ["session.mcap", "any.bag"])
    def test_a_damaged_recording_is_one_line(self, name: str, tmp_path: Path) -> None:
        (tmp_path / name).write_bytes(b"\x89MCAP0\r\n" + bytes(range(256)) * 20)
        with pytest.raises((CaptureError, UsageError)) as found:
            read_series(tmp_path / name, "imu")
        assert "\n" not in str(found.value)

    def test_a_link_in_the_place_of_a_session_is_refused(self, tmp_path: Path) -> None:
        (tmp_path / "session.mcap").symlink_to("/etc/passwd")
        with pytest.raises(Exception, match="is a link"):
            read_series(tmp_path, "imu")

    @pytest.mark.parametrize(
        ("text", "words"),
        [
            ("", "no column timestamp"),
            ("timestamp,ax,ay,az,wx,wy,wz\n", "got 0 samples"),
            ("timestamp,ax,ay,az,wx,wy,wz\n1,2,3\n", "line 2"),
            ("timestamp,ax,ay,az,wx,wy,wz\n1,2,3,4,5,6,x\n", "line 2"),
            ("timestamp,ax,ay,az,wx,wy,wz\n1,2,3,4,5,6,7\n2,2,3,4,5,6,\n", "empty"),
        ],
    )
    def test_a_wrong_csv_file_is_one_line(self, text: str, words: str, tmp_path: Path) -> None:
        (tmp_path / "a.csv").write_text(text)
        with pytest.raises(CaptureError, match=words):
            read_series(tmp_path / "a.csv", "imu")

    def test_times_that_stand_still_have_no_rate(self, tmp_path: Path) -> None:
        rows = "1,2,3,4,5,6,7\n" * 5
        (tmp_path / "a.csv").write_text("timestamp,ax,ay,az,wx,wy,wz\n" + rows)
        with pytest.raises(CaptureError, match="do not ascend"):
            _ = read_series(tmp_path / "a.csv", "imu").rate_hz

    def test_the_rate_of_samples_that_arrive_in_batches_is_their_mean(self, tmp_path: Path) -> None:
        times = np.floor(np.arange(4000) / 400.0 / 0.016) * 0.016
        rows = "".join(f"{time:.3f},2,3,4,5,6,7\n" for time in times)
        (tmp_path / "a.csv").write_text("timestamp,ax,ay,az,wx,wy,wz\n" + rows)
        assert read_series(tmp_path / "a.csv", "imu").rate_hz == pytest.approx(400.0, rel=0.002)

    def test_another_file_is_refused(self, tmp_path: Path) -> None:
        with pytest.raises(UsageError, match=r"valid: a \.csv file, the folder of a session"):
            read_series(tmp_path / "a.txt", "imu")


def imu_fields(row: np.ndarray):
    x, y, z, a, b, c = map(float, row)
    return {
        "of": lambda make: {
            "linear_acceleration": make("geometry_msgs/msg/Vector3", x=x, y=y, z=z),
            "angular_velocity": make("geometry_msgs/msg/Vector3", x=a, y=b, z=c),
            "orientation": make("geometry_msgs/msg/Quaternion", x=0.0, y=0.0, z=0.0, w=1.0),
            "orientation_covariance": np.array([-1.0, *[0.0] * 8]),
            "angular_velocity_covariance": np.zeros(9),
            "linear_acceleration_covariance": np.zeros(9),
        }
    }


def test_a_model_corrects_what_it_describes() -> None:
    assert np.array_equal(ImuModel().gyroscope.correct(np.eye(3)), np.eye(3))
