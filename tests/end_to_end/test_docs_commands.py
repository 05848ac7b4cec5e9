"""All blocks of each page run in their order, in an environment and a folder of their own.

The environment has what the README installs, and nothing of the page before. The folder has
``grasps.zarr`` and the files that the page takes for its reader's own. A block that a reader cannot
run like this has no language.
"""

from __future__ import annotations

import csv
import json
import os
import re
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Mapping
from pathlib import Path

import cv2
import numpy as np
import pytest
import trimesh
from support.board_images import BoardRenderer, board_poses, random_pose
from support.inertial_records import positions_record, still_record, write_csv
from support.loaded_poses import loaded_poses
from support.onnx_file import square_finder
from support.page_blocks import BLOCK, script_of
from support.places import DOCS, REPOSITORY
from support.scale import IS_SOAK

from grasp_factory.core.geometry import inverse

pytestmark = pytest.mark.soak

README = REPOSITORY / "README.md"
PAGES = {
    str(page.relative_to(DOCS)): page
    for page in sorted(DOCS.rglob("*.md"))
    if BLOCK.search(page.read_text(encoding="utf-8"))
}
IN_A_CLONE = ("guides/cluster.md", "guides/installing.md")
"""Pages whose commands are for the folder of a clone."""
SERVING = ("guides/browse.md",)
"""Pages whose last command serves until Ctrl-C."""
MOST_S = 1800.0
"""Longest time that the blocks of a page may take."""


def wrenches(folder: Path) -> None:
    rows = np.random.default_rng(0).normal(0.0, 0.002, (150, 6)).tolist()
    lines = [",".join(map(repr, [k / 1000.0, *row])) for k, row in enumerate(rows)]
    (folder / "still_wrench.csv").write_text("\n".join(["timestamp,fx,fy,fz,tx,ty,tz", *lines]))
    names = ["qx", "qy", "qz", "qw", *(f"c{k}" for k in range(6))]
    with (folder / "loads.csv").open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow([*names, "load_mass", "load_x", "load_y", "load_z"])
        for pose in loaded_poses(40, noise=0.01):
            writer.writerow([*pose.quat_xyzw, *pose.raw, pose.load_mass, *pose.load_com])


def recordings(folder: Path) -> None:
    """Write what is recorded for a calibration of an IMU, a force-torque sensor, a camera."""
    write_csv(folder / "still.csv", *still_record(seconds=60.0, rate_hz=100.0))
    write_csv(folder / "turned.csv", *positions_record(count=16, rate_hz=100.0, aligned=False))
    wrenches(folder)
    rng, renderer = np.random.default_rng(0), BoardRenderer.make()
    (folder / "board_images").mkdir()
    for k, pose in enumerate(board_poses(15, rng)):
        cv2.imwrite(str(folder / "board_images" / f"{k}.png"), renderer.image(pose, rng))
    X, board = random_pose(rng, 0.1), random_pose(rng, 0.5)
    hands = [random_pose(rng, 0.5) for _ in range(10)]
    pairs = [
        {
            "T_base_gripper": hand.tolist(),
            "T_camera_target": (inverse(X) @ inverse(hand) @ board).tolist(),
        }
        for hand in hands
    ]
    (folder / "pairs.json").write_text(json.dumps(pairs))


def plates(folder: Path) -> None:
    square_finder(folder / "plates.onnx", 128)


def meshes(folder: Path) -> None:
    (folder / "my_meshes").mkdir()
    trimesh.creation.box((0.03, 0.05, 0.07)).export(folder / "my_meshes" / "box.stl")


OWN: Mapping[str, Callable[[Path], None]] = {
    "guides/calibration.md": recordings,
    "guides/privacy.md": plates,
    "guides/objects.md": meshes,
}
"""What writes the files that a page takes for its reader's own."""


def clean_environment(folder: Path) -> dict[str, str]:
    """Return the variables of a shell in which a virtual environment is active."""
    kept = {name: value for name, value in os.environ.items() if "PYTHON" not in name}
    path = os.pathsep.join([str(folder / "bin"), os.environ["PATH"]])
    return {**kept, "PATH": path, "VIRTUAL_ENV": str(folder)}


@pytest.fixture(scope="module")
def clone(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a clone with a store that ``generate`` has made in it."""
    clone = tmp_path_factory.mktemp("docs") / "clone"
    subprocess.run(["git", "clone", "--quiet", REPOSITORY, clone], check=True)
    command = [sys.executable, "-m", "grasp_factory", "generate", "--n", "50", "--quiet"]
    subprocess.run(command, cwd=clone, check=True)
    return clone


@pytest.fixture(scope="module")
def installed(clone: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with ``venv``, which the README has made, and a copy ``kept`` of it."""
    folder = tmp_path_factory.mktemp("installed")
    (install, *_) = [code for _, code in BLOCK.findall(README.read_text(encoding="utf-8"))]
    subprocess.run(
        ["bash", "-e", "-c", install.replace(".venv", str(folder / "venv"))],
        cwd=clone, env=clean_environment(folder / "venv"), check=True, capture_output=True,
    )  # fmt: skip
    subprocess.run(["cp", "-a", folder / "venv", folder / "kept"], check=True)
    return folder


@pytest.fixture
def env(installed: Path, tmp_path: Path) -> dict[str, str]:
    """Return the variables of a shell in which the environment of the README is active, as new."""
    shutil.rmtree(installed / "venv")
    subprocess.run(["cp", "-a", installed / "kept", installed / "venv"], check=True)
    cache = {"GRASP_FACTORY_CACHE": str(tmp_path / "cache")}
    return clean_environment(installed / "venv") | cache


def run(script: str, folder: Path, env: Mapping[str, str], *, serves: bool) -> tuple[int, str]:
    """Run a script; if it serves, press Ctrl-C as soon as it has printed an address.

    Returns:
        The exit code, and all that it has printed.
    """
    said = folder / "printed.txt"
    with said.open("w") as file:
        process = subprocess.Popen(
            ["bash", "-c", script], cwd=folder, env=env, stdin=subprocess.DEVNULL,
            stdout=file, stderr=subprocess.STDOUT, start_new_session=True,
        )  # fmt: skip
        try:
            while serves and process.poll() is None:
                if re.search(r"http://\S+", said.read_text()):
                    os.killpg(process.pid, signal.SIGINT)
                    break
                time.sleep(0.2)
            code = process.wait(MOST_S)
        finally:
            if process.poll() is None:
                os.killpg(process.pid, signal.SIGKILL)
                process.wait()
    return code, said.read_text()


@pytest.mark.timeout(2 * MOST_S)
@pytest.mark.skipif(not IS_SOAK, reason="takes half an hour")
@pytest.mark.parametrize("name", PAGES)
def test_the_blocks_of_a_page_run_as_they_stand(
    name: str, clone: Path, env: dict[str, str], tmp_path: Path
) -> None:
    if name in IN_A_CLONE:
        folder = tmp_path / "clone"
        subprocess.run(["git", "clone", "--quiet", REPOSITORY, folder], check=True)
    else:
        folder = tmp_path / "work"
        folder.mkdir()
        subprocess.run(["cp", "-r", clone / "grasps.zarr", folder], check=True)
    if make := OWN.get(name):
        make(folder)
    serves = name in SERVING
    code, printed = run(script_of(PAGES[name]), folder, env, serves=serves)
    assert code in ((0, 130) if serves else (0,)), printed[-3000:]


def test_what_pages_take_for_their_readers_own_is_named_by_them() -> None:
    assert {*OWN, *SERVING, *IN_A_CLONE} <= set(PAGES)
