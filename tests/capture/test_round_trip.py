"""An episode that simulated devices play over real transports, in a store again."""

from __future__ import annotations

import subprocess
import sys
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from support.places import TINY

from grasp_factory.core.episode import Episode
from grasp_factory.dataset.dataset import Dataset
from grasp_factory.signals.noise import noisy

pytestmark = pytest.mark.soak
"""It records in real time."""

ROW = 1


@pytest.fixture(scope="module")
def played() -> Episode:
    return noisy(Dataset(TINY)[ROW], "stereo")


@pytest.fixture(scope="module")
def imported(tmp_path_factory: pytest.TempPathFactory) -> Episode:
    session = tmp_path_factory.mktemp("round") / "demo"
    store = session.parent / "real.zarr"
    command("capture", "demo", TINY, "--row", ROW, "--out", session)
    command("capture", "import", session, "--out", store)
    return Dataset(store)[0]


def command(*words: object) -> None:
    subprocess.run([sys.executable, "-m", "grasp_factory", *map(str, words)], check=True)


def expected(played: Episode) -> dict[str, dict[str, NDArray[Any]]]:
    """Return the times and values of each series, with the resolution of its device."""
    streams = played.streams
    at = streams["timestamp"]
    return {
        "imu": {"timestamp": played.imu["timestamp"],
                "specific_force": played.imu["specific_force"],
                "angular_velocity": played.imu["angular_velocity"]},
        "force_torque": {"timestamp": at, "wrench": streams["wrist_wrench"]},
        "joints": {"timestamp": at, "positions": streams["joint_positions"],
                   "velocities": streams["joint_velocities"],
                   "gripper_width": streams["gripper_width"]},
    }  # fmt: skip


TOLERANCE = {"specific_force": 5e-4, "angular_velocity": 5e-4, "wrench": 1e-5}
"""Half a count of the device; what is not named is equal."""


@pytest.mark.parametrize("group", ["imu", "force_torque", "joints"])
def test_every_value_is_that_of_the_episode(group: str, imported: Episode, played: Episode) -> None:
    found = imported.imu if group == "imu" else imported.own_rate[group]
    for name, values in expected(played)[group].items():
        if name != "timestamp":
            atol = TOLERANCE.get(name, 1e-12)
            np.testing.assert_allclose(found[name], values, atol=atol, rtol=0.0, err_msg=name)


@pytest.mark.parametrize("group", ["imu", "force_torque", "joints", "taxels"])
def test_times_are_within_a_millisecond(group: str, imported: Episode, played: Episode) -> None:
    found = imported.imu if group == "imu" else imported.own_rate[group]
    true = expected(played).get(group, {"timestamp": played.streams["timestamp"]})["timestamp"]
    offset = found["timestamp"] - true
    off = np.abs(offset - np.median(offset))
    assert off.max() < 1e-3


def test_images_are_those_of_the_episode(imported: Episode, played: Episode) -> None:
    camera = next(iter(played.cameras))
    (found,) = imported.cameras.values()
    np.testing.assert_array_equal(found.rgb[0], played.cameras[camera].rgb[0])


def test_the_label_is_that_of_the_episode(imported: Episode, played: Episode) -> None:
    assert imported.success == played.success
