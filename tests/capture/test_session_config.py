"""Settings of sessions: strict, with the nearest valid key, and names of folders and topics."""

from __future__ import annotations

from collections.abc import Iterator
from datetime import UTC, date, datetime
from pathlib import Path
from typing import Any

import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st
from support.ticking_devices import models, registered

from grasp_factory.capture.session.camera_info import camera_intrinsics
from grasp_factory.capture.session.session_config import (
    SessionConfig,
    calibration_files,
    read_session_config,
)
from grasp_factory.capture.session.topic_names import topics_of
from grasp_factory.core.serialization import from_plain, to_plain
from grasp_factory.errors import CaptureError, GraspFactoryError, UsageError

IMU: dict[str, Any] = {"driver": "ticking_imu"}
ARM: dict[str, Any] = {"driver": "ticking_arm"}
CAMERA: dict[str, Any] = {"driver": "ticking_camera"}
START = datetime(2026, 1, 31, 12, tzinfo=UTC)


@pytest.fixture(scope="module", autouse=True)
def devices() -> Iterator[None]:
    with registered():
        yield


def config(**plain: Any) -> SessionConfig:
    return from_plain(SessionConfig, {"devices": {"imu": IMU}, **plain})


def topics(**plain: Any) -> dict[str, dict[str, str]]:
    found = config(**plain)
    known = models()
    return topics_of(found, {name: known[d.driver] for name, d in found.devices.items()})


@pytest.mark.parametrize(
    ("plain", "text"),
    [
        ({"operater": "me"}, "unknown key 'operater'; did you mean 'operator'?"),
        ({"devices": {}}, "devices: got 0, valid: 1 to 64"),
        ({"devices": {"1 x": IMU}}, "a name of ROS"),
        ({"devices": {"imu": {}}}, "missing key 'devices.imu.driver'"),
        (
            {"devices": {"imu": {**IMU, "rate": 400}}},
            "unknown key 'devices.imu.rate'; did you mean 'rate_hz'?",
        ),
        (
            {"devices": {"imu": {**IMU, "driver": "ticking_imo"}}},
            "unknown driver 'ticking_imo'; did you mean 'ticking_imu'?",
        ),
        (
            {"devices": {"imu": {**IMU, "settings": {"widht": 2}}}},
            "unknown key 'devices.imu.settings.widht'; did you mean 'width'?",
        ),
        ({"tolerances": {"gaps": 1}}, "unknown key 'tolerances.gaps'; did you mean"),
        ({"duration_s": 0}, "duration_s: got 0.0, valid: 0.1 to"),
        ({"names": "articel"}, "names: got 'articel', valid: plain, article, article_sync"),
        ({"name": "../x"}, "name: got '../x', valid: letters"),
        ({"hook": "python move.py"}, "hook: expected a list"),
        ({"devices": {"imu": {**IMU, "rate_hz": -1}}}, "rate_hz: got -1.0"),
        ({"environment": {"light": float("nan")}}, "environment.light: got nan, valid: a text"),
        ({"consent": {"on": date(2026, 1, 31)}}, "consent.on: got datetime.date(2026, 1, 31), val"),
        ({"firmware": {"arm": {date(2026, 1, 31): 1}}}, "firmware.arm.2026-01-31: got"),
        ({"devices": {"imu": {**IMU, "topics": {"imu": "a b"}}}}, "a name of ROS such as"),
    ],
)
def test_a_mistake_is_named_with_what_is_valid(
    plain: dict[str, Any], text: str, tmp_path: Path
) -> None:
    file = tmp_path / "session.yaml"
    file.write_text(yaml.safe_dump({"devices": {"imu": IMU}, **plain}))
    with pytest.raises(UsageError) as raised:
        read_session_config(file)
    assert text in str(raised.value)


@pytest.mark.parametrize(
    ("plain", "name"),
    [
        ({}, "session_20260131_120000"),
        ({"names": "article"}, "ego_data_20260131_120000"),
        ({"names": "article_sync"}, "session_1769860800"),
        ({"name": "visual_data_{epoch}"}, "visual_data_1769860800"),
        ({"name": "kitchen"}, "kitchen"),
    ],
)
def test_a_folder_has_the_name_that_was_chosen(plain: dict[str, Any], name: str) -> None:
    assert config(**plain).folder_name(START) == name


def test_topics_have_plain_names_names_of_the_articles_or_given_ones() -> None:
    three = {"imu": IMU, "front": CAMERA, "arm": ARM}
    assert topics(devices=three)["front"] == {
        "image": "/front/image",
        "depth": "/front/depth",
        "camera_info": "/front/camera_info",
    }
    article = topics(devices=three, names="article")
    assert article["front"] == {
        "image": "/camera/color/image_raw",
        "depth": "/camera/aligned_depth_to_color/image_raw",
        "camera_info": "/camera/color/camera_info",
    }
    assert article["imu"]["imu"] == "/imu/data"
    assert article["arm"]["joint_states"] == "/joint_states"
    assert topics(devices=three, names="article_sync")["imu"]["imu"] == "/imu/data_raw"
    given_name = topics(devices={"imu": {**IMU, "topics": {"imu": "/wrist/imu"}}})
    assert given_name["imu"]["imu"] == "/wrist/imu"


@pytest.mark.parametrize(
    ("plain", "text"),
    [
        ({"devices": {"a": IMU, "b": IMU}, "names": "article"}, "/imu/data is that of devices.a"),
        ({"devices": {"a": {**IMU, "topics": {"imu": "/events"}}}}, "is that of the events"),
        ({"devices": {"a": {**IMU, "topics": {"image": "/x"}}}}, "valid: imu, temperature"),
        (
            {"devices": {"a": {**IMU, "full_scale": {"force": 1.0}}}},
            "(valid: specific_force, angular_velocity)",
        ),
    ],
)
def test_topics_and_quantities_must_fit_the_device(plain: dict[str, Any], text: str) -> None:
    with pytest.raises(UsageError) as raised:
        topics(**plain)
    assert text in str(raised.value)


def test_settings_are_the_same_after_they_were_stored() -> None:
    found = config(operator="me", environment={"light": [1, 2]}, consent={"given": "yes"})
    assert from_plain(SessionConfig, yaml.safe_load(yaml.safe_dump(to_plain(found)))) == found


def test_a_calibration_file_lies_beside_the_settings(tmp_path: Path) -> None:
    found = config(devices={"front": {**CAMERA, "calibration": "front.yaml"}})
    with pytest.raises(UsageError, match=r"devices.front.calibration: got 'front.yaml'"):
        calibration_files(found, tmp_path)
    (tmp_path / "front.yaml").touch()
    assert calibration_files(found, tmp_path) == {"front": tmp_path / "front.yaml"}


CAMCHAIN = {
    "camera_model": "pinhole",
    "intrinsics": [600.0, 601.0, 320.0, 240.0],
    "distortion_model": "radtan",
    "distortion_coeffs": [0.1, -0.2, 0.001, 0.002],
    "resolution": [640, 480],
}


def intrinsics(data: Any) -> Any:
    return camera_intrinsics(yaml.safe_dump(data).encode(), Path("c.yaml"))


def test_a_camchain_and_a_matrix_give_the_same_camera() -> None:
    matrix = {
        "width": 640,
        "height": 480,
        "K": [[600.0, 0, 320.0], [0, 601.0, 240.0], [0, 0, 1]],
        "D": [0.1, -0.2, 0.001, 0.002, 0.0],
    }
    assert intrinsics({"cam0": CAMCHAIN}) == intrinsics(matrix)
    fisheye = {**CAMCHAIN, "distortion_model": "equidistant"}
    assert intrinsics({"cam0": fisheye}).model == "equidistant"


@pytest.mark.parametrize(
    "data",
    [
        None,
        [1],
        {"cam0": None},
        {"cam0": {**CAMCHAIN, "camera_model": "omni"}},
        {"cam0": {**CAMCHAIN, "distortion_model": "fov"}},
        {"cam0": {**CAMCHAIN, "resolution": [0, 480]}},
        {"cam0": {**CAMCHAIN, "resolution": [10**9, 480]}},
        {"cam0": {**CAMCHAIN, "intrinsics": [float("nan"), 1.0, 1.0, 1.0]}},
        {"cam0": {**CAMCHAIN, "distortion_coeffs": [0.1] * 12}},
        {"width": 640, "height": 480, "K": [1, 2]},
    ],
)
def test_what_is_no_camera_is_refused(data: Any) -> None:
    with pytest.raises(CaptureError, match="is no calibration of a camera"):
        intrinsics(data)


@given(st.binary(max_size=200))
def test_any_bytes_are_a_camera_or_an_error(content: bytes) -> None:
    try:
        camera_intrinsics(content, Path("c.yaml"))
    except GraspFactoryError:
        pass
