"""The commands ``calibrate``: they write their files, and say in a line what is wrong."""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Iterator
from pathlib import Path

import click
import cv2
import numpy as np
import pytest
from support.board_images import BoardRenderer, board_poses, random_pose
from support.inertial_records import still_record, write_csv

from grasp_factory.capture.calibration.ft_calibration import read_ft
from grasp_factory.capture.calibration.hand_eye_file import read_hand_eye
from grasp_factory.capture.calibration.kalibr import read_camchain, read_imu
from grasp_factory.cli.calibrate import CALIBRATE_COMMANDS, calibrate
from grasp_factory.core.geometry import inverse
from grasp_factory.errors import EXIT_FAILURE, EXIT_USAGE

Run = Callable[..., tuple[int, str, str]]
ALL = [command for several in CALIBRATE_COMMANDS.values() for command in several]


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    monkeypatch.chdir(tmp_path)
    yield tmp_path


def write_wrenches(path: Path, *, shake: float = 0.0, load: float = 0.0) -> None:
    rows = np.random.default_rng(0).normal(0.0, 0.002, (150, 6))
    rows[:, 2] += shake * np.sin(np.arange(150)) + load
    lines = [",".join(map(repr, [k / 1000.0, *row])) for k, row in enumerate(rows.tolist())]
    path.write_text("\n".join(["timestamp,fx,fy,fz,tx,ty,tz", *lines]))


def write_pairs(path: Path, count: int = 6) -> np.ndarray:
    rng = np.random.default_rng(0)
    X, board = random_pose(rng, 0.1), random_pose(rng, 0.5)
    hands = [random_pose(rng, 0.5) for _ in range(count)]
    pairs = [
        {"T_base_gripper": hand.tolist(),
         "T_camera_target": (inverse(X) @ inverse(hand) @ board).tolist()} for hand in hands
    ]  # fmt: skip
    path.write_text(json.dumps(pairs))
    return X


def test_an_inertial_sensor_gets_its_folder(here: Path, run: Run) -> None:
    write_csv(here / "still.csv", *still_record(seconds=20.0, rate_hz=100.0))
    code, out, err = run("calibrate", "imu", "still.csv", "out")
    assert code == 0, err
    assert "out: 0.3332 min at 100 Hz" in out
    assert sorted(os.listdir(here / "out")) == ["allan.png", "imu.yaml", "imu_model.yaml"]
    assert read_imu(here / "out/imu.yaml").update_rate == 100.0
    code, out, err = run("calibrate", "imu", "still.csv", "out")
    assert (code, out) == (EXIT_USAGE, "")
    assert err.count("\n") == 1
    assert "overwrites nothing" in err


def test_a_force_torque_sensor_is_tared_and_refused_under_load_and_in_motion(
    here: Path, run: Run
) -> None:
    write_wrenches(here / "still.csv")
    write_wrenches(here / "shaken.csv", shake=3.0)
    write_wrenches(here / "loaded.csv", load=8.0)
    assert run("calibrate", "ft", "a.yaml", "--tare", "still.csv")[0] == 0
    assert run("calibrate", "ft", "b.yaml", "--tare", "still.csv", "--from", "a.yaml")[0] == 0
    for name, words in (("shaken", "the tool moves"), ("loaded", "the tool is under load")):
        code, out, err = run(
            "calibrate", "ft", "c.yaml", "--tare", f"{name}.csv", "--from", "a.yaml"
        )
        assert (code, out, err.count("\n")) == (EXIT_FAILURE, "", 1)
        assert words in err
    assert not (here / "c.yaml").exists()
    assert np.abs(read_ft(here / "a.yaml").zero).max() < 0.01


def test_a_camera_and_its_place_on_the_hand_are_found(here: Path, run: Run) -> None:
    rng, renderer = np.random.default_rng(0), BoardRenderer.make()
    (here / "images").mkdir()
    for k, pose in enumerate(board_poses(8, rng)):
        cv2.imwrite(f"images/{k}.png", renderer.image(pose, rng))
    code, out, err = run("calibrate", "camera", "images", "camchain.yaml")
    assert code == 0, err
    assert "8 of 8 images" in out
    assert read_camchain(here / "camchain.yaml")[0].resolution == (640, 480)
    X = write_pairs(here / "pairs.json")
    code, out, err = run("calibrate", "hand-eye", "pairs.json", "hand.yaml", "--json")
    assert code == 0, err
    assert np.allclose(json.loads(out)["transform"], X, atol=1e-6)
    assert np.allclose(read_hand_eye(here / "hand.yaml").transform, X, atol=1e-6)


@pytest.mark.parametrize(
    "line",
    [
        "imu none.csv out",
        "ft out.yaml",
        "ft out.yaml --tare none.csv --poses none.csv",
        "ft out.yaml --tare none.csv --from none.yaml",
        "camera none out.yaml",
        "camera . out.yaml --board 2x2",
        "hand-eye none.json out.yaml",
        "hand-eye none out.yaml --poses none.csv",
        "hand-eye . out.yaml --setup nowhere",
    ],
)
def test_a_users_mistake_is_one_line_and_exit_code_2(line: str, here: Path, run: Run) -> None:
    code, out, err = run("calibrate", *line.split())
    assert (code, out) == (EXIT_USAGE, "")
    assert err.splitlines()[-1].startswith("Error: ")
    assert "Traceback" not in err
    assert list(here.iterdir()) == []


@pytest.mark.parametrize("command", ALL, ids=lambda command: str(command.name))
def test_an_example_of_the_help_is_a_valid_command_line(command: click.Command) -> None:
    for line in command.examples:  # type: ignore[attr-defined]
        words = line.split()
        assert words[:3] == ["grasp-factory", "calibrate", command.name]
        with command.make_context(str(command.name), words[3:]):
            pass


@pytest.mark.parametrize("command", ALL, ids=lambda command: str(command.name))
def test_a_help_fits_80_columns_and_its_first_line_is_a_sentence(command: click.Command) -> None:
    parent = click.Context(calibrate, info_name="grasp-factory calibrate", terminal_width=80)
    text = command.get_help(click.Context(command, info_name=command.name, parent=parent))
    assert [line for line in text.partition("\nExamples:")[0].splitlines() if len(line) > 80] == []
    assert command.help
    assert command.help.splitlines()[0].endswith(".")
