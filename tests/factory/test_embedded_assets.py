"""A dataset of a user's own objects, from the folder to the replay on another machine."""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import zarr
from support.helpers import assert_same_tree

from grasp_factory.dataset.dataset import Dataset

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


@pytest.fixture
def home(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Work in an empty folder with an empty cache, and two cubes in ``things``."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("GRASP_FACTORY_CACHE", str(tmp_path / "cache"))
    (tmp_path / "things").mkdir()
    (tmp_path / "things" / "small.obj").write_text(CUBE.format(s="0.02"))
    (tmp_path / "things" / "größer.obj").write_text(CUBE.format(s="25"))
    (tmp_path / "things" / "broken.stl").write_text("solid of nothing")
    return tmp_path


def run(*args: object) -> subprocess.CompletedProcess[str]:
    return subprocess.run([*COMMAND, *map(str, args)], capture_output=True, text=True, check=False)


def generate(out: str, *more: object) -> subprocess.CompletedProcess[str]:
    return run("generate", "--objects", "things", *SMALL, "--out", out, "--quiet", *more)


def test_a_folder_is_used_with_its_refusals_and_warnings_named(home: Path) -> None:
    done = generate("a.zarr", "--workers", "1")
    assert done.returncode == 0, done.stderr
    assert "things: broken.stl is skipped: it has no faces" in done.stderr
    assert "größer.obj: taken as millimetres" in done.stderr
    ids = set(Dataset.open(home / "a.zarr").column("object_id"))
    assert ids <= {"things/small", "things/größer"}


def test_the_same_folder_elsewhere_gives_the_same_bytes_with_any_workers(
    home: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert generate("a.zarr", "--workers", "1").returncode == 0
    (home / "other").mkdir()
    shutil.move(home / "things", home / "other" / "things")
    monkeypatch.chdir(home / "other")
    monkeypatch.setenv("GRASP_FACTORY_CACHE", str(home / "another_cache"))
    assert generate("b.zarr", "--workers", "2").returncode == 0
    assert_same_tree(home / "a.zarr", home / "other" / "b.zarr")


def test_a_dataset_replays_where_the_folder_never_was(
    home: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert generate("a.zarr", "--workers", "1").returncode == 0
    shutil.rmtree(home / "things")
    monkeypatch.setenv("GRASP_FACTORY_CACHE", str(home / "empty"))
    done = run("replay", "a.zarr", 2)
    assert done.returncode == 0, done.stderr
    assert "replays to the same bytes" in done.stdout


def test_going_on_elsewhere_converts_no_mesh_again(
    home: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Conversion may differ by machine, so it is done once: here what converts cannot be loaded."""
    assert generate("whole.zarr", "--workers", "1", "--n", "6").returncode == 0
    assert generate("a.zarr", "--workers", "1").returncode == 0
    config = Dataset.open(home / "a.zarr").config
    (home / "config.yaml").write_text(json.dumps(config.to_plain()))
    shutil.rmtree(home / "things")
    (home / "broken").mkdir()
    for library in ("trimesh", "coacd", "scipy", "fast_simplification"):
        (home / "broken" / f"{library}.py").write_text("raise SystemExit('it was loaded')")
    monkeypatch.setenv("PYTHONPATH", str(home / "broken"))
    monkeypatch.setenv("GRASP_FACTORY_CACHE", str(home / "empty"))
    for command in (
        ("replay", "a.zarr", 1),
        ("generate", "--config", "config.yaml", "--out", "a.zarr", "--n", "6", "--workers", "2"),
    ):
        done = run(*command)
        assert done.returncode == 0, done.stderr
    assert_same_tree(home / "whole.zarr", home / "a.zarr")


def test_a_folder_that_changed_is_another_dataset(home: Path) -> None:
    assert generate("a.zarr", "--workers", "1").returncode == 0
    (home / "things" / "new.obj").write_text(CUBE.format(s="0.015"))
    done = generate("a.zarr", "--workers", "1")
    assert done.returncode == 2
    assert "object_folders.things" in done.stderr
    assert "Traceback" not in done.stderr


def test_objects_of_a_damaged_store_are_refused(home: Path, monkeypatch: Any) -> None:
    assert generate("a.zarr", "--workers", "1").returncode == 0
    array = zarr.open_array(home / "a.zarr" / "objects" / "things", mode="r+")
    data = np.asarray(array[:])
    data[len(data) // 2] ^= 1
    array[:] = data
    monkeypatch.setenv("GRASP_FACTORY_CACHE", str(home / "empty"))
    done = run("replay", "a.zarr", 2)
    assert done.returncode == 1
    assert done.stderr.count("\n") == 1
    assert not list((home / "empty").rglob("*.obj"))


class TestListing:
    def test_a_folder_is_reported_without_generating(self, home: Path) -> None:
        done = run("objects", "things")
        assert done.returncode == 0
        for words in ("things/small", "things/größer", "40 x 40 x 40", "broken.stl: it has no"):
            assert words in done.stdout

    def test_json_has_every_object_and_refusal(self, home: Path) -> None:
        report = json.loads(run("objects", "things", "--json").stdout)
        assert {item["object_id"] for item in report["usable"]} == {"things/small", "things/größer"}
        assert [item["file"] for item in report["refused"]] == ["broken.stl"]

    def test_a_folder_without_any_usable_object_exits_with_1(self, home: Path) -> None:
        for name in ("small.obj", "größer.obj"):
            (home / "things" / name).unlink()
        assert run("objects", "things").returncode == 1
        done = generate("a.zarr")
        assert done.returncode == 2
        assert "no usable object" in done.stderr
        assert not (home / "a.zarr").exists()

    @pytest.mark.parametrize("name", ["./nothing", "things/small.obj"])
    def test_what_is_no_folder_is_refused_in_a_line(self, home: Path, name: str) -> None:
        for command in (("objects", name), ("generate", "--objects", name)):
            done = run(*command)
            assert done.returncode == 2
            assert done.stderr.count("\n") == 1, done.stderr

    def test_too_wide_depends_on_the_robot(self, home: Path) -> None:
        (home / "things" / "wide.obj").write_text(CUBE.format(s="0.045"))
        assert "things/wide" in run("objects", "things").stdout
        panda = run("objects", "things", "--robot", "panda").stdout
        assert "wide.obj: " in panda
        assert "things/wide" not in panda
