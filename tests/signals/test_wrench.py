from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import zarr
from hypothesis import given
from hypothesis import strategies as st
from support.places import TINY

from grasp_factory.core.config.factory_config import FactoryConfig
from grasp_factory.core.enums import Phase
from grasp_factory.core.geometry import Array, quat_xyzw_to_matrix
from grasp_factory.errors import UsageError
from grasp_factory.signals import calibrate, compensate_gravity, rotations, tare, tool_load
from grasp_factory.signals.wrench import GRAVITY

SEEDS = st.integers(0, 2**32 - 1)


def random_rotations(rng: np.random.Generator, count: int) -> Array:
    return rotations(rng.normal(size=(count, 4)))


def weighed(masses: Array, points: Array, R_world_sensor: Array, gravity: Array) -> Array:
    """Return the wrench of point masses on the sensor, mass by mass, worked out in the world."""
    out = []
    for R in R_world_sensor:
        force, moment = np.zeros(3), np.zeros(3)
        for mass, point in zip(masses, points, strict=True):
            force += mass * gravity
            moment += np.cross(R @ point, mass * gravity)
        out.append(np.concatenate([R.T @ force, R.T @ moment]))
    return np.array(out)


class TestTare:
    @given(SEEDS)
    def test_the_load_is_what_is_left_of_an_offset_sensor(self, seed: int) -> None:
        rng = np.random.default_rng(seed)
        load, offset = rng.normal(size=(20, 6)), rng.normal(size=6)
        load[:5] = 0.0
        np.testing.assert_allclose(tare(load + offset, slice(0, 5)), load, atol=1e-12)

    def test_a_mask_and_a_slice_choose_the_same_window(self) -> None:
        wrench = np.random.default_rng(0).normal(size=(9, 6))
        mask = np.arange(9) < 4
        np.testing.assert_array_equal(tare(wrench, mask), tare(wrench, slice(None, 4)))
        np.testing.assert_allclose(tare(wrench, mask)[:4].mean(axis=0), 0.0, atol=1e-15)

    def test_the_argument_stays_what_it_was(self) -> None:
        wrench = np.ones((4, 6), np.float32)
        assert tare(wrench, slice(2)).dtype == np.float64
        assert (wrench == 1.0).all()

    @pytest.mark.parametrize("window", [slice(4, 4), np.zeros(4, bool)], ids=["slice", "mask"])
    def test_an_empty_window_is_refused(self, window: Any) -> None:
        with pytest.raises(UsageError, match="no record of 4 is in the window"):
            tare(np.ones((4, 6)), window)


class TestCompensateGravity:
    @given(SEEDS, st.integers(1, 5))
    def test_nothing_is_left_of_a_tool_in_any_orientation(self, seed: int, parts: int) -> None:
        rng = np.random.default_rng(seed)
        masses, points = rng.uniform(0.1, 3.0, parts), rng.uniform(-0.2, 0.2, (parts, 3))
        R, gravity = random_rotations(rng, 7), rng.normal(0.0, 10.0, 3)
        com = masses @ points / masses.sum()
        left = compensate_gravity(
            weighed(masses, points, R, gravity), R, masses.sum(), com, gravity
        )
        np.testing.assert_allclose(left, 0.0, atol=1e-10)

    @given(SEEDS)
    def test_the_load_from_outside_is_left(self, seed: int) -> None:
        rng = np.random.default_rng(seed)
        R, outside = random_rotations(rng, 5), rng.normal(size=(5, 6))
        tool = weighed(np.array([1.2]), np.array([[0.0, 0.01, 0.07]]), R, np.array(GRAVITY))
        left = compensate_gravity(tool + outside, R, 1.2, (0.0, 0.01, 0.07))
        np.testing.assert_allclose(left, outside, atol=1e-12)

    def test_a_tool_that_hangs_down_pulls_along_its_axis(self) -> None:
        # Looking down, sensor z is world -z: the weight pulls along +z and has no lever.
        down = np.diag([1.0, -1.0, -1.0])
        np.testing.assert_allclose(
            tool_load(down, 2.0, (0.0, 0.0, 0.1)), [0, 0, 19.62, 0, 0, 0], atol=1e-12
        )

    def test_a_tool_that_points_sideways_has_a_lever(self) -> None:
        # Sensor z is world x, sensor x is world -z: the weight pulls along +x, 0.1 m out on z.
        aside = np.array([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]])
        np.testing.assert_allclose(
            tool_load(aside, 2.0, (0.0, 0.0, 0.1)), [19.62, 0, 0, 0, 1.962, 0], atol=1e-12
        )

    def test_in_free_fall_a_tool_weighs_nothing(self) -> None:
        fall = np.array(GRAVITY) - np.tile(GRAVITY, (3, 1))
        assert (tool_load(np.tile(np.eye(3), (3, 1, 1)), 1.0, (0.1, 0.2, 0.3), fall) == 0).all()

    def test_gravity_is_the_simulators(self) -> None:
        assert -FactoryConfig().physics.gravity == GRAVITY[2]

    def test_rotations_are_those_of_the_poses_quaternions(self) -> None:
        poses = np.random.default_rng(1).normal(size=(2, 3, 7))
        R = rotations(poses)
        assert R.shape == (2, 3, 3, 3)
        np.testing.assert_array_equal(R[1, 2], quat_xyzw_to_matrix(poses[1, 2, 3:]))
        assert rotations(poses[:0]).shape == (0, 3, 3, 3)


class TestCalibrate:
    @given(SEEDS)
    def test_it_undoes_a_linear_sensor(self, seed: int) -> None:
        rng = np.random.default_rng(seed)
        wrench, gain, bias = rng.normal(size=(8, 6)), rng.normal(size=(6, 6)), rng.normal(size=6)
        gain += 6.0 * np.eye(6)
        raw = wrench @ gain.T + bias
        np.testing.assert_allclose(calibrate(raw, np.linalg.inv(gain), bias), wrench, atol=1e-9)

    def test_rows_of_the_matrix_are_outputs(self) -> None:
        matrix = np.zeros((6, 6))
        matrix[0, 1] = 3.0  # fx from the second channel
        out = calibrate([[1.0, 5.0, 0, 0, 0, 0]], matrix, [0, 1.0, 0, 0, 0, 0])
        np.testing.assert_array_equal(out, [[12.0, 0, 0, 0, 0, 0]])

    @pytest.mark.parametrize(
        ("matrix", "bias", "message"),
        [
            (np.eye(3), np.zeros(6), r"matrix has shape \(3, 3\), valid: \(6, 6\)"),
            (np.eye(6), np.zeros((1, 6)), r"bias has shape \(1, 6\), valid: \(6,\)"),
        ],
        ids=["matrix", "bias"],
    )
    def test_another_shape_is_refused(self, matrix: Array, bias: Array, message: str) -> None:
        with pytest.raises(UsageError, match=message):
            calibrate(np.zeros((2, 6)), matrix, bias)


@pytest.fixture(scope="module")
def held() -> dict[str, Any]:
    """The heaviest object held in the shipped dataset: what is needed of it, and of its robot."""
    root = zarr.open_group(TINY, mode="r")
    i = int(np.argmax(root["episodes/object_mass"][:] * root["episodes/success"][:]))
    n = int(root["episodes/n_steps"][i])
    names = ("wrist_wrench", "tcp_pose", "phase", "object_pose")
    return {name: np.asarray(root[f"streams/{name}"][i, :n]) for name in names} | {
        "mass": float(root["episodes/object_mass"][i]),
        "com": np.asarray(root["episodes/object_com"][i, 0]),
        "robot": root.attrs["robot"],
    }


def test_what_is_left_of_a_real_hold_is_the_objects_weight(held: dict[str, Any]) -> None:
    R, robot = rotations(held["tcp_pose"]), held["robot"]
    wrench = compensate_gravity(held["wrist_wrench"], R, robot["tool_mass"], robot["tool_com"])
    hold = np.flatnonzero(held["phase"] == Phase.HOLD)[-20:]  # the swing of the lift is over
    force = np.einsum("tij,tj->ti", R, wrench[:, :3])[hold]
    weight = held["mass"] * np.array(GRAVITY)
    error = np.linalg.norm(force - weight, axis=1) / np.linalg.norm(weight)
    assert error.max() < 0.02
    # The moment is that of the weight at the object's centre of mass. Where the sensor lies on the
    # TCP's axis is not in the store, so that one distance is fitted.
    moment = np.einsum("tij,tj->ti", R, wrench[:, 3:])[hold]
    pose, tcp = held["object_pose"][hold, 0].astype(float), held["tcp_pose"][hold, :3]
    about_tcp = np.cross(pose[:, :3] + rotations(pose) @ held["com"] - tcp, weight)
    per_metre = np.cross(R[hold][:, :, 2], weight)
    distance = np.linalg.lstsq(per_metre.reshape(-1, 1), (moment - about_tcp).ravel())[0]
    lever = np.linalg.norm(moment - about_tcp - per_metre * distance, axis=1) / -weight[2]
    assert lever.max() < 5e-4
