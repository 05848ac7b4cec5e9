"""A dataset of a user's own objects, from the folder to the replay on another machine."""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import zarr
from support.conversion import convert_here
from support.helpers import assert_same_tree
from support.places import REPOSITORY

from grasp_factory.dataset.dataset import Dataset
from grasp_factory.factory import generate as factory

pytestmark = pytest.mark.slow

COMMAND = [sys.executable, "-m", "grasp_factory"]
SMALL = ("--resolution", "64x48", "--set", "block_size=2", "--policy", "top_down", "--n", "4")

CUBE = """\
v -{s} -{s} -{s}
v {s} -{s} -{s}
v {s} {s} -{s}
v -{s} {s} -{s}
v -{s} -{s} {s}
v {s} -{s} {s}
v {s} {s} {s}
v -{s} {s} {s}
f 4 3 2 1
f 5 6 7 8
f 1 2 6 5
f 2 3 7 6
f 3 4 8 7
f 4 1 5 8
"""


def settle(folder: Path, patch: pytest.MonkeyPatch) -> Path:
    """Work in an empty folder with an empty cache, and two cubes in ``things``."""
    patch.chdir(folder)
    patch.setenv("GRASP_FACTORY_CACHE", str(folder / "cache"))
    (folder / "things").mkdir()
    (folder / "things" / "small.obj").write_text(CUBE.format(s="0.02"))
    (folder / "things" / "größer.obj").write_text(CUBE.format(s="25"))
    (folder / "things" / "broken.stl").write_text("solid of nothing")
    return folder


@pytest.fixture
def home(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return an empty folder that has been settled in; meshes are converted in this process."""
    convert_here(monkeypatch)
    return settle(tmp_path, monkeypatch)


def command(*args: object) -> subprocess.CompletedProcess[str]:
    """Run the command in a process of its own, which has nothing in its memory."""
    return subprocess.run([*COMMAND, *map(str, args)], capture_output=True, text=True, check=False)


def generate(out: str, *more: object) -> tuple[object, ...]:
    return ("generate", "--objects", "things", *SMALL, "--out", out, "--quiet", *more)


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, str]:
    """Return a folder with ``a.zarr`` beside its objects and cache, and what the run said."""
    with pytest.MonkeyPatch.context() as patch:
        folder = settle(tmp_path_factory.mktemp("made"), patch)
        done = command(*generate("a.zarr", "--workers", "1"))
    assert done.returncode == 0, done.stderr
    return folder, done.stderr


@pytest.fixture
def used(made: tuple[Path, str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Work in a copy of the folder with ``a.zarr``."""
    folder = Path(shutil.copytree(made[0], tmp_path / "used"))
    monkeypatch.chdir(folder)
    monkeypatch.setenv("GRASP_FACTORY_CACHE", str(folder / "cache"))
    return folder


@pytest.mark.soak
def test_a_folder_is_used_with_its_refusals_and_warnings_named(made: tuple[Path, str]) -> None:
    folder, said = made
    assert "things: broken.stl is skipped: it has no faces" in said
    assert "größer.obj: taken as millimetres" in said
    ids = set(Dataset(folder / "a.zarr").column("object_id"))
    assert ids <= {"things/small", "things/größer"}


@pytest.mark.soak
def test_the_same_folder_elsewhere_gives_the_same_bytes_with_any_workers(
    made: tuple[Path, str], home: Path
) -> None:
    done = command(*generate("b.zarr", "--workers", "2"))
    assert done.returncode == 0, done.stderr
    assert_same_tree(made[0] / "a.zarr", home / "b.zarr")


def test_a_dataset_replays_where_the_folder_never_was(
    used: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    shutil.rmtree(used / "things")
    monkeypatch.setenv("GRASP_FACTORY_CACHE", str(used / "empty"))
    done = command("replay", "a.zarr", 2)
    assert done.returncode == 0, done.stderr
    assert "replays to the same bytes" in done.stdout


@pytest.mark.soak
def test_going_on_elsewhere_converts_no_mesh_again(
    used: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Conversion may differ by machine, so it is done once: here what converts cannot be loaded."""
    config = Dataset(used / "a.zarr").config
    factory.generate(config, 6, used / "whole.zarr", workers=1)
    (used / "config.yaml").write_text(json.dumps(config.to_plain()))
    shutil.rmtree(used / "things")
    (used / "broken").mkdir()
    for library in ("trimesh", "coacd", "scipy", "fast_simplification"):
        (used / "broken" / f"{library}.py").write_text("raise SystemExit('it was loaded')")
    monkeypatch.setenv("PYTHONPATH", f"{used / 'broken'}:{REPOSITORY}")
    monkeypatch.setenv("GRASP_FACTORY_CACHE", str(used / "empty"))
    for words in (
        ("replay", "a.zarr", 1),
        ("generate", "--config", "config.yaml", "--out", "a.zarr", "--n", "6", "--workers", "2"),
    ):
        done = command(*words)
        assert done.returncode == 0, done.stderr
    assert_same_tree(used / "whole.zarr", used / "a.zarr")


def test_a_folder_that_changed_is_another_dataset(used: Path) -> None:
    (used / "things" / "new.obj").write_text(CUBE.format(s="0.015"))
    done = command(*generate("a.zarr", "--workers", "1"))
    assert done.returncode == 2
    assert "object_folders.things" in done.stderr
    assert "Traceback" not in done.stderr


def test_objects_of_a_damaged_store_are_refused(
    used: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    array = zarr.open_array(used / "a.zarr" / "objects" / "things", mode="r+")
    data = np.asarray(array[:])
    data[len(data) // 2] ^= 1
    array[:] = data
    monkeypatch.setenv("GRASP_FACTORY_CACHE", str(used / "empty"))
    done = command("replay", "a.zarr", 2)
    assert done.returncode == 1
    assert done.stderr.count("\n") == 1
    assert not list((used / "empty").rglob("*.obj"))


Run = Callable[..., tuple[int, str, str]]


class TestListing:
    def test_a_folder_is_reported_without_generating(self, home: Path, run: Run) -> None:
        code, said, _ = run("objects", "things")
        assert code == 0
        for words in ("things/small", "things/größer", "40 x 40 x 40", "broken.stl: it has no"):
            assert words in said

    def test_json_has_every_object_and_refusal(self, home: Path, run: Run) -> None:
        report = json.loads(run("objects", "things", "--json")[1])
        assert {item["object_id"] for item in report["usable"]} == {"things/small", "things/größer"}
        assert [item["file"] for item in report["refused"]] == ["broken.stl"]

    def test_a_folder_without_any_usable_object_exits_with_1(self, home: Path, run: Run) -> None:
        for name in ("small.obj", "größer.obj"):
            (home / "things" / name).unlink()
        assert run("objects", "things")[0] == 1
        code, _, said = run(*generate("a.zarr"))
        assert code == 2
        assert "no usable object" in said
        assert not (home / "a.zarr").exists()

    @pytest.mark.parametrize("name", ["./nothing", "things/small.obj"])
    def test_what_is_no_folder_is_refused_in_a_line(self, home: Path, run: Run, name: str) -> None:
        for words in (("objects", name), ("generate", "--objects", name)):
            code, _, said = run(*words)
            assert code == 2
            assert said.count("\n") == 1, said

    def test_too_wide_depends_on_the_robot(self, home: Path, run: Run) -> None:
        (home / "things" / "wide.obj").write_text(CUBE.format(s="0.045"))
        assert "things/wide" in run("objects", "things")[1]
        panda = run("objects", "things", "--robot", "panda")[1]
        assert "wide.obj: " in panda
        assert "things/wide" not in panda
